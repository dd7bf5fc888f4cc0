//! Python environments with packages of PyPI: the hosts of the tests (OctoPrint, printcore, and
//! Playwright, which drives a browser), and the tools that build wheels.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::steps::{Failure, Run};
use crate::system;

/// The requirements, and those that are installed without their own dependencies.
const REQUIREMENTS: &str = "tests/hosts/requirements.txt";
const WITHOUT_DEPENDENCIES: &str = "tests/hosts/without-dependencies.txt";

/// Makes the hosts' environment, unless one from the same files exists. Returns its folder.
pub fn install(run: &mut Run) -> Result<PathBuf, Failure> {
    let installed = [["--requirement", REQUIREMENTS].as_slice(), &["--no-deps", "--requirement", WITHOUT_DEPENDENCIES]];
    environment(run, "hosts: OctoPrint, printcore, Playwright", "hosts", &installed)
}

/// Makes a Python environment in a folder of cargo's with this name, unless one from the same files
/// exists. `installed`: arguments of `pip install`, each list ending with a file of requirements.
/// Returns its folder.
///
/// # Errors
/// Python or its module venv is missing, or a package cannot be installed.
pub fn environment(run: &mut Run, step: &'static str, name: &str, installed: &[&[&str]]) -> Result<PathBuf, Failure> {
    run.step(step, || {
        let folder = system::target_directory().join(name);
        let wanted = wanted(installed)?;
        let stamp = folder.join("installed.txt");
        if std::fs::read_to_string(&stamp).is_ok_and(|installed| installed == wanted) {
            return Ok(folder);
        }
        let missing =
            |error| format!("{error}\nthey need Python 3.9 or newer with its module venv: install python3-venv");
        system::run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder)).map_err(missing)?;
        installed.iter().try_for_each(|arguments| pip(&folder, arguments))?;
        std::fs::write(&stamp, wanted).map_err(|error| format!("{}: {error}", stamp.display()))?;
        Ok(folder)
    })
}

/// The text of all files of requirements.
fn wanted(installed: &[&[&str]]) -> Result<String, Failure> {
    let files = installed.iter().filter_map(|arguments| arguments.last());
    let read = |file: &&str| {
        let path = system::root().join(file);
        std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))
    };
    files.map(read).collect()
}

fn pip(folder: &Path, arguments: &[&str]) -> Result<(), Failure> {
    let mut command = Command::new(folder.join("bin/python"));
    command.current_dir(system::root()).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
    system::run(command.args(arguments))
}
