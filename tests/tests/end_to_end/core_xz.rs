//! A CoreXZ machine: homed, printed, estimated and prepared like any other; the reference
//! checks every step.

use std::fs::{self, File};

use ferrostep_oracle::reference::{InterpretOptions, ReferenceProfile, interpret, plan};
use ferrostep_oracle::trace_check::{TraceCheckOptions, check_trace};
use serde_json::Value;

use crate::end_to_end::command::{directory, example, ferrostep, file, repository};

/// The cartesian profile with motors A and C, of equal steps, for X and Z.
fn machine() -> String {
    let cartesian = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let mut text = cartesian.clone();
    for (from, to) in [("kinematics = \"cartesian\"", "kinematics = \"corexz\""), ("y = 80, z = 400", "y = 80, z = 80")]
    {
        assert_eq!(text.matches(from).count(), 1, "{from}");
        text = text.replace(from, to);
    }
    text
}

fn summary(arguments: &[&str]) -> Value {
    let outcome = ferrostep(arguments.iter().copied().chain(["--json"]));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    outcome.json()
}

#[test]
fn the_cube_is_printed_estimated_and_prepared() {
    let directory = directory();
    let machine = machine();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let (trace, job) = (path("trace"), path("job.gpre"));
    let profile = file(&directory, "profile.toml", &machine);
    let profile = profile.to_str().unwrap();
    let gcode = "examples/cube.gcode";
    let printed = summary(&["print", gcode, "--profile", profile, "--trace", &trace]);

    let reference = ReferenceProfile::from_toml(&machine).unwrap();
    let text = example("cube.gcode");
    let report = check_trace(File::open(&trace).unwrap(), &text, &reference, &TraceCheckOptions::default()).unwrap();
    assert!(report.passed(), "{report}");
    let expected = interpret(&text, &reference, InterpretOptions::default()).unwrap();
    assert_eq!(report.moves, expected.move_count() as u64);
    assert_eq!(printed["order_digest"], report.order_digest_hex());
    let motion_time_s = plan(&expected, None).motion_time_s;
    for (axis, units) in ["x", "y", "z", "e"].into_iter().zip(expected.logical_end_10nm) {
        let stands_mm = printed["position_mm"][axis].as_f64().unwrap();
        assert!((stands_mm - units as f64 / 100_000.0).abs() < 1e-9, "{axis} at {stands_mm}");
    }

    let estimated = summary(&["estimate", gcode, "--profile", profile]);
    for figures in [&printed, &estimated] {
        let measured_s = figures["motion_time_s"].as_f64().unwrap();
        assert!((measured_s / motion_time_s - 1.0).abs() < 1e-4, "{measured_s} {motion_time_s}");
    }
    summary(&["preprocess", gcode, "-o", &job, "--profile", profile]);
    let executed = summary(&["print", &job, "--profile", profile]);
    let planned = summary(&["print", gcode, "--profile", profile, "--look-ahead", "65536"]);
    for key in ["step_digest", "motor_steps", "position_mm"] {
        assert_eq!(executed[key], planned[key], "{key}");
    }
}

/// The motors of X and Z hold both axes together: without current in one of them neither axis is
/// homed, and soft limits do not apply.
#[test]
fn a_motor_without_current_takes_the_home_of_both_its_axes() {
    let directory = directory();
    let profile = file(&directory, "profile.toml", machine());
    let clamped = |name: &str, axis_off: &str| {
        let job = file(&directory, name, format!("G28\nM84 {axis_off}\nG1 Z250 F6000\nG1 Y250\n"));
        let summary = summary(&["print", job.to_str().unwrap(), "--profile", profile.to_str().unwrap()]);
        (summary["clamped_moves"].as_u64().unwrap(), summary["position_mm"]["z"].as_f64().unwrap())
    };
    assert_eq!(clamped("all-on.gcode", "E"), (2, 200.0));
    assert_eq!(clamped("y-off.gcode", "Y"), (1, 200.0));
    for axis in ["X", "Z"] {
        assert_eq!(clamped("off.gcode", axis), (1, 250.0), "{axis}");
    }
}
