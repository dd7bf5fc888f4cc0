//! Lets the linker keep the tests' names and places, for a runner over a debug probe.

fn main() {
    println!("cargo:rustc-link-arg-bin=on-target=-Tembedded-test.x");
    println!("cargo:rerun-if-changed=build.rs");
}
