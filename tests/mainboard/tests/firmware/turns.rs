//! The list of how image tests take turns (`tests/turns.toml`), held against the tests.

use std::collections::BTreeSet;
use std::process::Command;

use xtask::turns::Turns;

/// Subjects that every check tests, with the modules that do.
const KINDS: [(&str, &[&str]); 10] = [
    ("heat", &["heaters"]),
    ("homing", &["z_motors", "bltouch", "tools"]),
    ("host", &["same_steps"]),
    ("card", &["card"]),
    ("probe", &["bltouch"]),
    ("tools", &["tools"]),
    ("supply", &["supply"]),
    ("watchdog", &["watchdog"]),
    ("pins", &["board_pins"]),
    ("stops", &["emergency"]),
];

/// The names of this program's tests.
fn names() -> BTreeSet<String> {
    let output = Command::new(std::env::current_exe().unwrap()).args(["--list", "--format", "terse"]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().filter_map(|line| line.strip_suffix(": test")).map(str::to_owned).collect()
}

#[test]
fn every_listed_test_exists() {
    let (turns, names) = (Turns::read().unwrap(), names());
    assert!((2..=20).contains(&turns.turns), "twenty checks run every test: {} turns", turns.turns);
    let unknown = turns.unknown(&names);
    assert!(unknown.is_empty(), "turns.toml lists tests that do not exist: {unknown:?}");
}

#[test]
fn some_test_of_each_kind_runs_in_every_check() {
    let (turns, names) = (Turns::read().unwrap(), names());
    for (kind, modules) in KINDS {
        let is_of = |name: &str| modules.iter().any(|module| name.starts_with(&format!("firmware::{module}::")));
        assert!(
            names.iter().any(|name| is_of(name) && turns.runs_always(name)),
            "no test of {kind} runs in every check"
        );
    }
}
