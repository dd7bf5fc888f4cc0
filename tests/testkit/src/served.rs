//! The printer of `ferrostep serve`, its hosts and its page; and the report of `print`
//! on the same lines.
#![allow(clippy::unwrap_used, reason = "without the program no test can say anything")]

pub mod page;
pub mod printer;

use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use serde_json::Value;

use crate::program::{program, repository, scratch};

/// The job of most tests, from the root.
pub const CUBE: &str = "examples/cube.gcode";

/// The first lines of a print, which home, heat and print the first layers.
///
/// # Panics
/// The example cannot be read.
pub fn part() -> Vec<String> {
    let text = std::fs::read_to_string(repository().join(CUBE)).unwrap();
    let commands = text.lines().filter_map(|line| line.split(';').next()).map(str::trim);
    commands.filter(|command| !command.is_empty()).take(1_500).map(str::to_owned).collect()
}

/// The report of `print` for a file, whose path begins at the root.
///
/// # Panics
/// The file cannot be printed.
pub fn print_of(file: &Path) -> Value {
    let mut print = Command::new(program());
    let output = print.args(["print", "--json"]).arg(file).current_dir(repository()).output().unwrap();
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The report of `print` for these lines.
///
/// # Panics
/// The lines cannot be printed.
pub fn print_of_lines(lines: &[String]) -> Value {
    let folder = scratch();
    let file = folder.path().join("part.gcode");
    std::fs::write(&file, lines.join("\n")).unwrap();
    print_of(&file)
}

/// The report of `print` for the cube, made once.
///
/// # Panics
/// The cube cannot be printed.
pub fn print_of_cube() -> &'static Value {
    static PRINTED: OnceLock<Value> = OnceLock::new();
    PRINTED.get_or_init(|| print_of(Path::new(CUBE)))
}
