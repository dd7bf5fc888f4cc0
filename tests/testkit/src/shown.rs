//! Pages of `ferrostep show` and `ferrostep compare`, and the prints on them.
#![allow(clippy::unwrap_used, reason = "without the program no test can say anything")]

pub mod prints;

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Output};

use crate::program::program;

/// Runs `show` in a folder, without opening the page.
///
/// # Panics
/// The program cannot be run.
pub fn show<A: AsRef<OsStr>>(folder: &Path, arguments: impl IntoIterator<Item = A>) -> Output {
    Command::new(program()).current_dir(folder).args(["show", "--no-open"]).args(arguments).output().unwrap()
}

/// Runs `compare` in a folder, without opening the page.
///
/// # Panics
/// The program cannot be run.
pub fn compare(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(program()).current_dir(folder).args(["compare", "--no-open"]).args(arguments).output().unwrap()
}

/// Text that a run has written to its standard error.
///
/// # Panics
/// The bytes are not text.
pub fn errors(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}
