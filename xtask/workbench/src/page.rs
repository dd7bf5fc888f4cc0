//! The page that reads a print in a browser: the program compiled to WebAssembly, and the page
//! around it.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::steps::{Failure, Run};
use crate::system::{self, cargo};
use crate::{core_library, firmware};

/// The program's target: WebAssembly, with files and standard output as a system has them.
const TARGET: &str = "wasm32-wasip1";

/// The profile of the program's build.
const PROFILE: &str = "page";

/// Builds the page and prints its path.
pub fn run(run: &mut Run) -> Result<(), Failure> {
    println!("{}", build(run)?.display());
    Ok(())
}

/// Builds the page into the target folder, and returns its path.
///
/// # Errors
/// The target's library cannot be installed, the program does not compile, or the page would be too
/// large.
pub fn build(run: &mut Run) -> Result<PathBuf, Failure> {
    let program = run.step("program as WebAssembly", || {
        let added = system::run(Command::new("rustup").args(["target", "add", TARGET]).current_dir(system::root()));
        let mut build = cargo();
        build.args(["build", "--locked", "--package", "ferrostep-browser", "--target", TARGET, "--profile", PROFILE]);
        // The same bytes wherever the folders lie.
        build.arg("--config").arg(firmware::renamed_folders("build", &core_library::folders()?)?);
        system::run(&mut build).map_err(|error| match added {
            Ok(()) => error,
            Err(reason) => format!("{error}\nthe library of {TARGET} is needed: {reason}"),
        })?;
        let program = system::target_directory().join(TARGET).join(PROFILE).join("ferrostep-browser.wasm");
        fs::read(&program).map_err(|error| format!("{}: {error}", program.display()))
    })?;
    run.step("page", || {
        let page = ferrostep_browser::page::composed(&program).map_err(|error| error.to_string())?;
        let path = system::target_directory().join("ferrostep-page.html");
        eprintln!("    {} bytes, of them {} of the program before it is packed", page.len(), program.len());
        fs::write(&path, page).map_err(|error| format!("{}: {error}", path.display()))?;
        Ok(path)
    })
}
