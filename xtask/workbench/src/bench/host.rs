//! Speed of the desk. The figures depend on the computer and its load, so they are shown
//! and never compared.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use crate::steps::Failure;
use crate::system::{self, cargo};

/// Builds `ferrostep` and lets it estimate and print all examples: lines and seconds of motion
/// for each second.
pub fn measure() -> Result<Value, Failure> {
    system::run(cargo().args(["build", "--profile", "dist", "--package", "ferrostep", "--bin", "ferrostep"]))?;
    let program = system::target_directory().join("dist/ferrostep");
    let (mut lines, mut estimate_s) = (0.0, 0.0);
    let (mut motion_s, mut print_s) = (0.0, 0.0);
    for file in examples()? {
        let estimate = summary(&program, "estimate", &file)?;
        lines += number(&estimate, "lines")?;
        estimate_s += number(&estimate, "wall_s")?;
        let print = summary(&program, "print", &file)?;
        motion_s += number(&print, "motion_time_s")?;
        print_s += number(&print, "wall_s")?;
    }
    if estimate_s <= 0.0 || print_s <= 0.0 {
        return Err("the examples took no time".to_owned());
    }
    let rounded = |value: f64| value.round() as u64;
    Ok(json!({
        "estimate_lines_per_s": rounded(lines / estimate_s),
        "realtime_factor": rounded(motion_s / print_s),
    }))
}

/// The sliced files that come with the project, in the order of their names.
fn examples() -> Result<Vec<PathBuf>, Failure> {
    let folder = system::root().join("examples");
    let entries = std::fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let is_print = |path: &PathBuf| {
        let name = path.to_string_lossy();
        [".gcode", ".gcode.gz", ".bgcode"].iter().any(|ending| name.ends_with(ending))
    };
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_print).collect();
    files.sort();
    Ok(files)
}

/// The machine for which an example was sliced, by the file's name.
pub fn profile(file: &Path) -> &'static str {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    if name.contains("corexy") { "corexy" } else { "cartesian" }
}

fn summary(program: &Path, task: &str, file: &Path) -> Result<Value, Failure> {
    let mut command = Command::new(program);
    command.arg(task).arg(file).args(["--profile", profile(file), "--json"]);
    let text = system::output(&mut command).ok_or_else(|| format!("`ferrostep {task}` fails on {}", file.display()))?;
    serde_json::from_str(&text).map_err(|error| format!("`ferrostep {task} --json`: {error}"))
}

/// A number of the summary.
pub fn number(summary: &Value, key: &str) -> Result<f64, Failure> {
    summary.get(key).and_then(Value::as_f64).ok_or_else(|| format!("`ferrostep --json` tells no {key}"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_example_is_run_on_the_machine_that_its_folder_names() {
        let readme = std::fs::read_to_string(system::root().join("examples/README.md")).unwrap();
        let files = examples().unwrap();
        let rows: Vec<&str> = readme.lines().filter(|line| line.starts_with("| `")).collect();
        assert_eq!(rows.len(), files.len());
        for row in rows {
            let file = files.iter().find(|file| row.contains(&*file.file_name().unwrap().to_string_lossy())).unwrap();
            assert!(row.ends_with(&format!("| {} |", profile(file))), "{row}");
        }
    }

    #[test]
    fn a_missing_number_is_named() {
        assert_eq!(number(&json!({"lines": 7}), "lines"), Ok(7.0));
        assert!(number(&json!({"lines": "7"}), "lines").unwrap_err().contains("lines"));
    }
}
