//! The list of the image tests that run in every check, held against the tests.
//!
//! `tests/turns.toml` says how the others take turns.

use std::collections::BTreeSet;
use std::process::Command;

/// The list.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Turns {
    /// Checks in a row that run every test once.
    turns: usize,
    /// Names, and modules, which end in `::`.
    always: Vec<String>,
}

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

fn turns() -> Turns {
    let path = crate::firmware::images::root().join("tests/mainboard/tests/turns.toml");
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// The names of this program's tests.
fn names() -> BTreeSet<String> {
    let output = Command::new(std::env::current_exe().unwrap()).args(["--list", "--format", "terse"]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().filter_map(|line| line.strip_suffix(": test")).map(str::to_owned).collect()
}

fn is_of(name: &str, listed: &str) -> bool {
    if listed.ends_with("::") { name.starts_with(listed) } else { name == listed }
}

#[test]
fn every_listed_test_exists() {
    let (listed, names) = (turns(), names());
    assert!((2..=20).contains(&listed.turns), "twenty checks run every test: {} turns", listed.turns);
    let missing: Vec<&String> =
        listed.always.iter().filter(|listed| !names.iter().any(|name| is_of(name, listed))).collect();
    assert!(missing.is_empty(), "turns.toml lists tests that do not exist: {missing:?}");
}

#[test]
fn some_test_of_each_kind_runs_in_every_check() {
    let listed = turns();
    for (kind, modules) in KINDS {
        let is_of = |name: &String| modules.iter().any(|module| name.starts_with(&format!("firmware::{module}::")));
        assert!(listed.always.iter().any(is_of), "no test of {kind} runs in every check");
    }
}
