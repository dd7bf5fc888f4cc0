//! OctoPrint with the plug-in that replaces its time by ours.

use std::process::Command;

use ferrostep_testkit::program::{program, repository, scratch};
use ferrostep_testkit::python;
use serde_json::Value;

/// OctoPrint shows our time beside its own sizes. Of a file that a printer would refuse it keeps
/// its own time, and its log says why.
#[test]
fn octoprint_shows_our_time() {
    let folder = scratch();
    let cold = folder.path().join("cold.gcode");
    std::fs::write(&cold, "G28\nG1 X10 Y10 Z0.2 F6000\nG1 X90 E5 F600\n").unwrap();
    let [folder, cold, command] = [folder.path(), &cold, program()].map(|path| path.to_str().unwrap());
    let file = "examples/cube.gcode";
    let seen = python::run("octoprint_estimates.py", &[command, "corexy", folder, file, cold]);

    let mut estimate = Command::new(program());
    estimate.args(["estimate", file, "--profile", "corexy", "--json"]).current_dir(repository());
    let expected: Value = serde_json::from_slice(&estimate.output().unwrap().stdout).unwrap();
    let [ours, kept] = [0, 1].map(|place| &seen["analyses"][place]);
    assert_eq!(ours["estimatedPrintTime"], expected["print_time_s"], "{seen:#}");
    assert!(ours["dimensions"]["height"].as_f64() > Some(1.0) && ours["filament"]["tool0"].is_object(), "{seen:#}");
    // 80 mm at 10 mm/s, by OctoPrint.
    assert!(kept["estimatedPrintTime"].as_f64().is_some_and(|time_s| (8.0..20.0).contains(&time_s)), "{seen:#}");
    let log = seen["log"].to_string();
    assert!(log.contains("estimates are made by ferrostep ") && log.contains("OctoPrint's own time stays"), "{log}");
    assert!(log.contains("cold extrusion prevented"), "{log}");
}
