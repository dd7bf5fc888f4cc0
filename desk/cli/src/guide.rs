//! The first steps, for a person who runs the command without arguments.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::SystemTime;

use crate::outcome::exit_code;
use crate::terminal;

/// Ends of the names of jobs.
const JOBS: [&str; 5] = [".gcode", ".bgcode", ".gco", ".gcode.gz", ".gcode.3mf"];

/// Configurations of other firmwares, from which a profile is made.
const CONFIGURATIONS: [&str; 2] = ["printer.cfg", "Configuration.h"];

/// Prints what to try, with the files of the working folder where there are some.
pub fn show() -> ExitCode {
    exit_code(terminal::write_result(&text(&names_here())))
}

/// Names of the working folder's files, the newest first.
fn names_here() -> Vec<String> {
    let entries = std::fs::read_dir(".").into_iter().flatten().flatten();
    let mut files: Vec<(SystemTime, PathBuf)> = entries
        .filter_map(|entry| {
            let about = entry.metadata().ok().filter(std::fs::Metadata::is_file)?;
            Some((about.modified().unwrap_or(SystemTime::UNIX_EPOCH), PathBuf::from(entry.file_name())))
        })
        .collect();
    files.sort();
    files.into_iter().rev().filter_map(|(_, name)| name.into_os_string().into_string().ok()).collect()
}

/// Returns true for a name that needs no quoting in any shell.
fn is_plain(name: &str) -> bool {
    name.starts_with(|char: char| char.is_ascii_alphanumeric())
        && name.chars().all(|char| char.is_ascii_alphanumeric() || matches!(char, '.' | '_' | '-'))
}

/// The guide. `names`: those of the available files, the preferred first.
fn text(names: &[String]) -> String {
    let plain = || names.iter().map(String::as_str).filter(|name| is_plain(name));
    let job = plain().find(|name| JOBS.iter().any(|end| name.ends_with(end))).unwrap_or("FILE.gcode");
    let configuration = plain().find(|name| CONFIGURATIONS.contains(name)).unwrap_or("printer.cfg");
    format!(
        "ferrostep executes a G-code file on a virtual printer, every step of it, and shows the result.\n\
         \n\
         What happens in a print, on one page in the browser; its time and material; every step of it:\n\
         \n    ferrostep show {job}\n    ferrostep estimate {job}\n    ferrostep print {job}\n\
         \n\
         The same for your printer, whose limits are in Klipper's printer.cfg or Marlin's Configuration.h:\n\
         \n    ferrostep import {configuration} -o my.toml\n    ferrostep show {job} --profile my.toml\n\
         \n\
         `ferrostep help` lists all commands, `ferrostep COMMAND --help` the options of one.\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(names: &[&str]) -> String {
        text(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn the_files_at_hand_are_named() {
        let guide = of(&["notes.txt", "part-2.gcode", "cube.bgcode", "Configuration.h"]);
        for line in
            ["show part-2.gcode\n", "import Configuration.h -o my.toml\n", "show part-2.gcode --profile my.toml\n"]
        {
            assert!(guide.contains(&format!("    ferrostep {line}")), "{guide}");
        }
    }

    #[test]
    fn a_name_that_a_shell_would_take_apart_is_left_out() {
        for name in ["a part.gcode", "-o.gcode", "$(x).gcode", "a;b.gcode", "ü.gcode"] {
            assert!(of(&[name]).contains("ferrostep show FILE.gcode\n"), "{name}");
        }
    }
}
