//! Version and commit of the tool, for `--version` and M115.

use std::env;
use std::path::Path;

use ferrostep_version::Version;

/// What goes into the tool.
const SOURCES: [&str; 12] = [
    "Cargo.lock",
    "Cargo.toml",
    "checked-toml",
    "cli",
    "gcode",
    "gpre",
    "hal-shim",
    "planner",
    "printer",
    "profiles",
    "square-root",
    "svg",
];

fn main() -> Result<(), env::VarError> {
    let root = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("..");
    let version = Version::of(env!("CARGO_PKG_VERSION"), &root, &SOURCES);
    version.watch();
    println!("cargo:rustc-env=FERROSTEP_VERSION={}", version.text);
    Ok(())
}
