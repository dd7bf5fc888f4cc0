//! Hosts for the tests, in a separate Python environment: OctoPrint, printcore, and Playwright,
//! which drives a browser, from PyPI.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::steps::{Failure, Run};
use crate::system;

/// The requirements, and those that are installed without their own dependencies.
const REQUIREMENTS: &str = "tests/hosts/requirements.txt";
const WITHOUT_DEPENDENCIES: &str = "tests/hosts/without-dependencies.txt";

/// Makes the environment, unless one from the same files exists. Returns its folder.
pub fn install(run: &mut Run) -> Result<PathBuf, Failure> {
    run.step("hosts: OctoPrint, printcore, Playwright", || {
        let folder = system::target_directory().join("hosts");
        let wanted = wanted()?;
        let stamp = folder.join("installed.txt");
        if std::fs::read_to_string(&stamp).is_ok_and(|installed| installed == wanted) {
            return Ok(folder);
        }
        let missing =
            |error| format!("{error}\nthe hosts need Python 3.9 or newer with its module venv: install python3-venv");
        system::run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder)).map_err(missing)?;
        pip(&folder, &["--requirement", REQUIREMENTS])?;
        pip(&folder, &["--no-deps", "--requirement", WITHOUT_DEPENDENCIES])?;
        std::fs::write(&stamp, wanted).map_err(|error| format!("{}: {error}", stamp.display()))?;
        Ok(folder)
    })
}

/// Both files' text.
fn wanted() -> Result<String, Failure> {
    let read = |file: &str| {
        let path = system::root().join(file);
        std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))
    };
    Ok(read(REQUIREMENTS)? + &read(WITHOUT_DEPENDENCIES)?)
}

fn pip(folder: &Path, arguments: &[&str]) -> Result<(), Failure> {
    let mut command = Command::new(folder.join("bin/python"));
    command.current_dir(system::root()).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
    system::run(command.args(arguments))
}
