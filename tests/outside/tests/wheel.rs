//! The wheel: built, installed into a fresh environment, its module called.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::process::Command;

use ferrostep_testkit::program::{program, repository, scratch};
use ferrostep_testkit::python;
use serde_json::Value;

/// The figures of the module are those of the command, and its exceptions have the command's words.
#[test]
fn a_wheel_brings_the_command_and_a_module_that_calls_it() {
    let folder = scratch();
    let stopping = folder.path().join("cold.gcode");
    std::fs::write(&stopping, "G28\nG1 X10 E5 F600\n").unwrap();
    let target = program().parent().and_then(|folder| folder.parent()).unwrap();
    let [target, wheels, stopping] = [target, folder.path(), &stopping].map(|path| path.to_str().unwrap());
    let file = "examples/cube.gcode";
    let seen = python::run("wheel.py", &[target, wheels, file, stopping]);
    let text = |key: &str| seen[key].as_str().unwrap_or_else(|| panic!("no {key} in {seen:#}"));

    let version = env!("CARGO_PKG_VERSION");
    assert!(text("wheel").starts_with(&format!("ferrostep-{version}-py3-none-linux_")), "{seen:#}");
    assert!(text("command").ends_with("/environment/bin/ferrostep"), "{seen:#}");
    let mut estimate = Command::new(program());
    estimate.args(["estimate", file, "--profile", "corexy", "--json"]).current_dir(repository());
    let expected: Value = serde_json::from_slice(&estimate.output().unwrap().stdout).unwrap();
    for key in ["file", "profile", "print_time_s", "motion_time_s", "filament_mm", "lines", "moves", "remarks"] {
        assert_eq!(seen["report"][key], expected[key], "{key}");
    }
    let [estimate_s, print_s, changed_s] = [0, 1, 2].map(|place| seen["time_s"][place].as_f64().unwrap());
    assert_eq!(Some(estimate_s), expected["print_time_s"].as_f64());
    // `compare` leaves out the job's own limits, and a wider corner is faster.
    assert!(0.0 < changed_s && changed_s < print_s, "{seen:#}");
    let page = std::fs::read_to_string(seen["page"][0].as_str().unwrap()).unwrap();
    assert!(page.starts_with("<!doctype html><!-- ferrostep show -->"), "{seen:#}");
    assert!(seen["page"][1].as_str().unwrap().contains(" moves, "), "{seen:#}");

    assert_eq!(seen["stopped"][0], 2, "{seen:#}");
    assert!(seen["stopped"][1].as_str().unwrap().contains("cold extrusion prevented"), "{seen:#}");
    assert!(text("refused").starts_with("no-such-file.gcode: "), "{seen:#}");
    assert_eq!(seen["profile"][0], "CannotStart");
    assert!(seen["profile"][1].as_str().unwrap().contains("corexy"), "{seen:#}");
}
