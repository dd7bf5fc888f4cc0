//! One line that names the tests which `cargo test` leaves to `cargo xtask test`.

#![allow(clippy::unwrap_used)]

use std::io::Write;

use ferrostep_testkit::program::repository;

#[test]
fn the_next_tier_is_named() {
    let outside = std::fs::read_to_string(repository().join("tests/outside/tests/main.rs")).unwrap();
    let modules: Vec<&str> = outside.lines().filter_map(|line| line.strip_prefix("mod ")?.strip_suffix(';')).collect();
    assert!(modules.contains(&"firmware") && modules.contains(&"hosts"), "{modules:?}");
    // Writes past the test harness, which shows only the output of tests that fail.
    let mut stderr = std::io::stderr().lock();
    writeln!(
        stderr,
        "left to `cargo xtask test`: the boards' images on the virtual mainboard, and tests with programs from outside ({})",
        modules.join(", ")
    )
    .unwrap();
}
