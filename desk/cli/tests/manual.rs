//! Completions and manual pages. Shells and groff read them in `tests/outside`.
//!
//! As a test of the command's own package it also has cargo build the command whenever all tests
//! are built: the programs in `tests` then find it.
#![allow(clippy::unwrap_used)]

use std::ffi::OsStr;
use std::fs;
use std::process::Command;

/// The result of one run.
#[derive(Debug)]
struct Outcome {
    status: Option<i32>,
    stdout: String,
    stderr: String,
}

fn ferrostep<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Outcome {
    let output = Command::new(env!("CARGO_BIN_EXE_ferrostep")).args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Outcome { status: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// The subcommands that `--help` lists.
fn subcommands() -> Vec<String> {
    let help = ferrostep(["--help"]).stdout;
    let listed = help.split_once("Commands:\n").unwrap().1.split("\n\n").next().unwrap();
    let names = listed.lines().filter_map(|line| line.strip_prefix("  ")).filter(|line| !line.starts_with(' '));
    names.filter_map(|line| line.split(' ').next()).filter(|name| *name != "help").map(str::to_owned).collect()
}

#[test]
fn every_shell_completes_every_subcommand() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let outcome = ferrostep(["completions", shell]);
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{shell}");
        let names = subcommands();
        assert!(names.len() > 10, "{names:?}");
        for name in names {
            assert!(outcome.stdout.contains(&name), "{shell} does not know {name}");
        }
    }
}

#[test]
fn every_subcommand_has_a_manual_page() {
    let directory = tempfile::tempdir().unwrap();
    let outcome = ferrostep(["man".as_ref(), "-o".as_ref(), directory.path().as_os_str()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let mut pages = vec!["ferrostep".to_owned()];
    pages.extend(subcommands().into_iter().map(|name| format!("ferrostep-{name}")));
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), pages.len());
    for page in pages {
        let path = directory.path().join(format!("{page}.1"));
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(".SH NAME") && text.contains(".SH SYNOPSIS"), "{page}");
        assert!(text.replace("\\-", "-").contains(&page), "{page}: {text}");
    }
    let whole = ferrostep(["man"]);
    assert_eq!(
        (whole.status, whole.stdout),
        (Some(0), fs::read_to_string(directory.path().join("ferrostep.1")).unwrap())
    );
    let missing = ferrostep(["man".as_ref(), "-o".as_ref(), directory.path().join("none").as_os_str()]);
    assert_eq!(missing.status, Some(2), "{missing:#?}");
    assert!(missing.stderr.contains("no such folder: create it"), "{missing:#?}");
}
