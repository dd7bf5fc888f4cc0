//! The slicers that tests slice with: PrusaSlicer and CuraEngine, as Debian packages them.

use std::path::PathBuf;
use std::process::Command;

use crate::steps::Failure;
use crate::system;

/// The feature of the tests that slice.
pub const FEATURE: &str = "ferrostep-tests/slicers";

/// The variable that tells those tests where Cura's printer definitions are: the folder above `definitions`.
pub const CURA_VARIABLE: &str = "FERROSTEP_CURA";

/// The slicers' programs and their packages.
const PROGRAMS: [(&str, &str); 2] = [("prusa-slicer", "prusa-slicer"), ("CuraEngine", "cura-engine")];

/// Where the package `cura` puts what all printer definitions inherit.
const CURA_RESOURCES: &str = "usr/share/cura/resources";

/// Makes both slicers available and returns the folder of Cura's definitions; `None` where they are neither installed nor can
/// be: without Debian's packages, or for a user who may not install any.
///
/// # Errors
/// Debian's packages are there, but cannot be fetched or installed.
pub fn find() -> Result<Option<PathBuf>, Failure> {
    let debian = system::output(Command::new("apt-get").arg("--version")).is_some();
    let root = system::output(Command::new("id").arg("-u")).is_some_and(|user| user == "0");
    let missing: Vec<&str> =
        PROGRAMS.iter().filter(|(program, _)| !is_on_path(program)).map(|(_, package)| *package).collect();
    if !debian || !(root || missing.is_empty()) {
        eprintln!("    not tested: needs Debian's packages prusa-slicer and cura-engine");
        return Ok(None);
    }
    if !missing.is_empty() {
        system::run(Command::new("apt-get").arg("update"))?;
        let mut install = Command::new("apt-get");
        install.env("DEBIAN_FRONTEND", "noninteractive").args(["install", "--yes", "--no-install-recommends"]);
        system::run(install.args(missing))?;
    }
    definitions().map(Some)
}

fn is_on_path(program: &str) -> bool {
    std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join(program).is_file()))
}

/// Cura's printer definitions: installed, or unpacked from the package, whose graphical program is not needed.
fn definitions() -> Result<PathBuf, Failure> {
    let has_definitions = |resources: &PathBuf| resources.join("definitions/fdmprinter.def.json").is_file();
    let installed = PathBuf::from("/").join(CURA_RESOURCES);
    if has_definitions(&installed) {
        return Ok(installed);
    }
    let folder = system::target_directory().join("slicers");
    let unpacked = folder.join(CURA_RESOURCES);
    if !has_definitions(&unpacked) {
        std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        system::run(Command::new("apt-get").current_dir(&folder).args(["download", "cura"]))?;
        let package = std::fs::read_dir(&folder)
            .map_err(|error| format!("{}: {error}", folder.display()))?
            .filter_map(|entry| entry.ok().map(|entry| entry.path()))
            .find(|path| path.extension().is_some_and(|extension| extension == "deb"))
            .ok_or("apt-get downloaded no package cura")?;
        system::run(Command::new("dpkg-deb").arg("-x").arg(package).arg(&folder))?;
    }
    if has_definitions(&unpacked) {
        Ok(unpacked)
    } else {
        Err("the package cura has no fdmprinter.def.json".to_owned())
    }
}
