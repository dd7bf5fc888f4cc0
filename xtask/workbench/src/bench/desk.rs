//! Cost of an estimate on the desk: instructions, counted by valgrind where it is installed.

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use super::host;
use crate::steps::Failure;
use crate::system::{self, cargo};

/// The files that are estimated: one whose time is mostly heat and homing, one of many lines, and
/// one on a machine with drivers on a serial line.
pub const FILES: [&str; 3] = ["cube.gcode", "gyroid.gcode.gz", "cube-corexy.gcode.gz"];

/// Counts; `None` without valgrind.
pub fn count() -> Result<Option<Value>, Failure> {
    if system::output(Command::new("valgrind").arg("--version")).is_none() {
        eprintln!("    valgrind is missing: the instructions of estimates are neither counted nor compared");
        return Ok(None);
    }
    system::run(cargo().args(["build", "--profile", "dist", "--package", "ferrostep", "--bin", "ferrostep"]))?;
    let program = system::target_directory().join("dist/ferrostep");
    let mut counts = serde_json::Map::new();
    for name in FILES {
        let path = Path::new("examples").join(name);
        let (instructions, lines) = estimate(&program, &path)?;
        let a_line = (instructions / lines * 10.0).round() / 10.0;
        counts.insert(key(name), json!({"instructions": instructions as u64, "a_line": a_line}));
    }
    Ok(Some(json!({ "estimate": counts })))
}

/// A file's key in the figures.
pub fn key(name: &str) -> String {
    name.split('.').next().unwrap_or(name).replace('-', "_")
}

/// All instructions of an estimate, from the process's start to its end, and the lines of its file.
fn estimate(program: &Path, file: &Path) -> Result<(f64, f64), Failure> {
    let mut command = Command::new("valgrind");
    command.current_dir(system::root()).args(["--tool=callgrind", "--callgrind-out-file=/dev/null"]).arg(program);
    command.arg("estimate").arg(file).args(["--profile", host::profile(file), "--json"]);
    let output = command.output().map_err(|error| format!("valgrind: {error}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    let nothing = || format!("valgrind counted nothing of {}: {said}", file.display());
    let summary = serde_json::from_slice(&output.stdout).map_err(|_| nothing())?;
    Ok((collected(&said).ok_or_else(nothing)?, host::number(&summary, "lines")?))
}

/// The count in callgrind's output.
fn collected(said: &str) -> Option<f64> {
    said.lines().find_map(|line| line.split_once("Collected : ")?.1.trim().parse().ok())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_count_is_found() {
        let said = "==1== Callgrind, a call-graph generating cache profiler\n==1== Events    : Ir\n==1== Collected : 161264628\n";
        assert_eq!(collected(said), Some(161_264_628.0));
        assert_eq!(collected("==1== Collected : many\n"), None);
        assert_eq!(collected(""), None);
    }

    #[test]
    fn keys_are_the_files_names() {
        assert_eq!(FILES.map(key), ["cube", "gyroid", "cube_corexy"]);
        assert!(FILES.iter().all(|name| system::root().join("examples").join(name).is_file()));
    }
}
