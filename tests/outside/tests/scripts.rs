//! The tests of the page's own programs, which Node.js runs.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::process::Command;

use ferrostep_testkit::program::repository;

#[test]
fn the_pages_programs_pass_their_tests() {
    let folder = repository().join("desk/show/page/tests");
    let files: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    let tests: Vec<_> = files.iter().filter(|file| file.to_string_lossy().ends_with(".test.mjs")).collect();
    assert!(tests.len() >= 3, "{files:?}");
    let output = Command::new("node").arg("--test").args(&tests).output();
    let output = output.expect("Node.js is missing: install it (Debian: apt-get install nodejs)");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
}
