//! Version and commit of the tool, for `--version` and M115.

use std::env;
use std::path::Path;

use ferrostep_version::Version;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("../..");
    let version = Version::of_package(env!("CARGO_PKG_VERSION"), &root, "desk/cli")?;
    version.watch();
    println!("cargo:rustc-env=FERROSTEP_VERSION={}", version.text);
    Ok(())
}
