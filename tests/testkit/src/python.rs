//! Hosts and a browser, driven by Python.
#![allow(clippy::unwrap_used, reason = "without them no test can say anything")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use serde_json::Value;

use crate::program::repository;

/// The hosts' Python.
fn python() -> &'static Path {
    static PYTHON: OnceLock<PathBuf> = OnceLock::new();
    PYTHON.get_or_init(|| {
        let folder = std::env::var("FERROSTEP_HOSTS").unwrap_or_else(|_| {
            let output =
                Command::new(env!("CARGO")).args(["xtask", "hosts"]).current_dir(repository()).output().unwrap();
            assert!(output.status.success(), "cargo xtask hosts: {}", String::from_utf8_lossy(&output.stderr));
            String::from_utf8(output.stdout).unwrap().lines().next().unwrap().to_owned()
        });
        Path::new(&folder).join("bin/python")
    })
}

/// Runs a script of `tests/hosts/`; returns the last line of its output.
///
/// # Panics
/// The script cannot be run, or fails.
#[track_caller]
pub fn run(script: &str, arguments: &[&str]) -> Value {
    let script = repository().join("tests/hosts").join(script);
    let output = Command::new(python()).arg(script).args(arguments).current_dir(repository()).output().unwrap();
    let (said, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{arguments:?}: {said}{errors}");
    let last = said.lines().next_back().unwrap_or_default();
    serde_json::from_str(last).unwrap_or_else(|error| panic!("{error} in {said}{errors}"))
}
