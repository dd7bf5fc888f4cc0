//! A printer for hosts to connect to: a board's image, unmodified, on the virtual mainboard.
//!
//! The machine is a program of its own (`mainboard/`), for its emulator wants a newer Rust than this one; this finds it and
//! hands over.

use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use crate::arguments::ServeArguments;

/// The program, as `cargo xtask mainboard` builds it.
const PROGRAM: &str = "mainboard/target/release/ferrostep-mainboard";

/// Serves until it is interrupted.
///
/// # Errors
/// There is no such board, or the machine has not been built.
pub fn run(arguments: &ServeArguments) -> Result<ExitCode, String> {
    let home = home().ok_or("no checkout of Ferrostep here: the virtual mainboard is built and run in one")?;
    let named = home.join("boards").join(format!("{}.toml", arguments.board));
    let board = if named.is_file() { named } else { PathBuf::from(&arguments.board) };
    if !board.is_file() {
        return Err(format!("{}: no such board; expected {} or a TOML file", arguments.board, names(&home)));
    }
    let program = home.join(PROGRAM);
    if !program.is_file() {
        return Err(format!(
            "the virtual mainboard has not been built; this builds it and the image: cargo xtask mainboard --board {}",
            arguments.board
        ));
    }
    let mut command = Command::new(&program);
    command.arg("serve").arg("--board").arg(&board).args(["--via", arguments.via.name()]);
    command.args(["--speed", &arguments.speed.to_string()]);
    if let Some(path) = &arguments.pty {
        command.arg("--pty").arg(path);
    }
    if let Some(port) = arguments.tcp {
        command.args(["--tcp", &port.to_string()]);
    }
    // In this program's place, so that a signal to it reaches the machine. It comes back only if it could not begin.
    Err(format!("{}: {}", program.display(), command.exec()))
}

/// The boards that have names, in words.
fn names(home: &Path) -> String {
    let files = std::fs::read_dir(home.join("boards")).into_iter().flatten().flatten().map(|entry| entry.path());
    let boards = files.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
    let mut names: Vec<String> = boards.filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned())).collect();
    names.retain(|name| name != "Cargo");
    names.sort();
    names.join(", ")
}

/// The checkout around the working folder, or around this program.
fn home() -> Option<PathBuf> {
    let starts = [std::env::current_dir().ok(), std::env::current_exe().ok()];
    let is_home = |folder: &&Path| folder.join("mainboard/Cargo.toml").is_file() && folder.join("boards").is_dir();
    starts.into_iter().flatten().find_map(|start| start.ancestors().find(is_home).map(Path::to_owned))
}
