//! A printer for hosts to connect to: a board's image, unmodified, on the virtual mainboard.
//!
//! The virtual mainboard is a separate program (`tests/mainboard/`), built only on request; this
//! module finds and starts it.

use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use ferrostep_checked_toml::closest;
use ferrostep_session::serve::Speed;

use crate::arguments::ServeArguments;

/// The program, as `cargo xtask mainboard` builds it.
const PROGRAM: &str = "target/debug/ferrostep-mainboard";

/// Folder of the built-in boards, from the checkout's root.
const BOARDS: &str = "config/boards";

/// Serves until the process is interrupted.
///
/// # Errors
/// The board is unknown, a page is wanted, or the virtual mainboard is not built yet.
pub fn run(board: &str, arguments: &ServeArguments) -> Result<ExitCode, String> {
    if arguments.web.is_some() {
        return Err(format!(
            "--web with --board: the image is in one program and its page in another: give the board a port (`ferrostep serve --board {board} \
             --tcp 5000`), and put the page in front of it from a second terminal (`ferrostep serve --web --port tcp:127.0.0.1:5000`)"
        ));
    }
    let home = home().ok_or(
        "serve needs a checkout of Ferrostep: change into one, build the virtual mainboard there, and run it again",
    )?;
    let Speed::Times(speed) = arguments.speed else {
        return Err("--speed max: an image runs by its own clock; write a number".to_owned());
    };
    let named = home.join(BOARDS).join(format!("{board}.toml"));
    let file = if named.is_file() { named } else { PathBuf::from(board) };
    if !file.is_file() {
        let names = names(&home);
        let meant = closest(board, names.iter().map(String::as_str));
        let meant = meant.map_or_else(String::new, |meant| format!("did you mean {meant}? "));
        return Err(format!("{board}: no such board: {meant}choose one of {}, or give a TOML file", names.join(", ")));
    }
    let program = home.join(PROGRAM);
    if !program.is_file() {
        return Err(format!(
            "the virtual mainboard is not built yet; this builds it and the image: cargo xtask mainboard --board {board}"
        ));
    }
    let mut command = Command::new(&program);
    command.arg("serve").arg("--board").arg(&file).args(["--via", arguments.via.name()]);
    command.args(["--speed", &speed.to_string()]);
    if let Some(path) = &arguments.pty {
        command.arg("--pty").arg(path);
    }
    if let Some(port) = arguments.tcp {
        command.args(["--tcp", &port.to_string()]);
    }
    // Replaces this process, so that signals reach the virtual mainboard. Returns only if it
    // could not start.
    Err(format!("{}: {}", program.display(), command.exec()))
}

/// The names of the built-in boards, separated by commas.
fn names(home: &Path) -> Vec<String> {
    let files = std::fs::read_dir(home.join(BOARDS)).into_iter().flatten().flatten().map(|entry| entry.path());
    let boards = files.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
    let mut names: Vec<String> = boards.filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned())).collect();
    names.retain(|name| name != "Cargo");
    names.sort();
    names
}

/// The checkout around the working folder, or around this program.
fn home() -> Option<PathBuf> {
    let starts = [std::env::current_dir().ok(), std::env::current_exe().ok()];
    let is_home = |folder: &&Path| folder.join("tests/mainboard/Cargo.toml").is_file() && folder.join(BOARDS).is_dir();
    starts.into_iter().flatten().find_map(|start| start.ancestors().find(is_home).map(Path::to_owned))
}
