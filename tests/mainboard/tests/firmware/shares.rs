//! The rotating share: which tests do not run in every check.
//!
//! `tests/shares.toml` lists the slow ones. A check runs all others, and of the listed ones those whose place, counted from 0, leaves
//! the check's share as its remainder by `shares`. Every kind of test keeps some that always run.

use std::collections::BTreeSet;
use std::process::Command;

/// The list.
#[derive(serde::Deserialize)]
struct Shares {
    /// How many checks run every test once.
    shares: usize,
    /// In their order.
    tests: Vec<Listed>,
}

/// A slow test.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Listed {
    name: String,
    /// Seconds of a core.
    seconds: f64,
}

/// What must be tested in every check, with the modules that do.
const KINDS: [(&str, &[&str]); 9] = [
    ("heat", &["heaters"]),
    ("homing", &["z_motors", "bltouch", "tools"]),
    ("host", &["same_steps"]),
    ("card", &["card"]),
    ("probe", &["bltouch"]),
    ("tools", &["tools"]),
    ("supply", &["supply"]),
    ("watchdog", &["watchdog"]),
    ("pins", &["board_pins"]),
];

fn shares() -> Shares {
    let path = crate::firmware::images::root().join("tests/mainboard/tests/shares.toml");
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// The names of this program's tests.
fn names() -> BTreeSet<String> {
    let output = Command::new(std::env::current_exe().unwrap()).args(["--list", "--format", "terse"]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().filter_map(|line| line.strip_suffix(": test")).map(str::to_owned).collect()
}

#[test]
fn every_test_of_the_rotating_share_exists() {
    let (listed, names) = (shares(), names());
    assert!((2..=20).contains(&listed.shares), "twenty checks run every test: {} shares", listed.shares);
    let listed_names = listed.tests.iter().map(|test| test.name.as_str());
    let missing: Vec<&str> = listed_names.filter(|name| !names.contains(*name)).collect();
    assert!(missing.is_empty(), "shares.toml lists tests that do not exist: {missing:?}");
    let once: BTreeSet<&str> = listed.tests.iter().map(|test| test.name.as_str()).collect();
    assert_eq!(once.len(), listed.tests.len(), "shares.toml lists a test twice");
}

/// What one check must wait for another need not.
#[test]
fn no_share_is_much_longer_than_another() {
    let listed = shares();
    let of_share =
        |share: usize| -> f64 { listed.tests.iter().skip(share).step_by(listed.shares).map(|test| test.seconds).sum() };
    let seconds: Vec<f64> = (0..listed.shares).map(of_share).collect();
    let (least, most) = seconds.iter().fold((f64::MAX, 0.0_f64), |(least, most), s| (least.min(*s), most.max(*s)));
    assert!(most < 1.3 * least, "seconds of each share: {seconds:?}");
}

#[test]
fn some_test_of_each_kind_runs_in_every_check() {
    let listed = shares();
    let always: Vec<String> =
        names().into_iter().filter(|name| !listed.tests.iter().any(|test| test.name == *name)).collect();
    for (kind, modules) in KINDS {
        let is_of = |name: &&String| modules.iter().any(|module| name.starts_with(&format!("firmware::{module}::")));
        assert!(always.iter().any(|name| is_of(&name)), "no test of {kind} runs in every check");
    }
}
