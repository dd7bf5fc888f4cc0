//! Real prints by each of the papers' methods of interpolation; the reference checks every step.

use std::fs::{self, File};

use ferrostep_oracle::reference::{InterpretOptions, ReferenceProfile, interpret, plan};
use ferrostep_oracle::trace_check::{TraceCheckOptions, TraceReport, check_trace};

use crate::end_to_end::command::{directory, example, ferrostep, file, repository};

/// The greatest errors that a method may make: from the line, and of each motor from its law.
struct Bounds {
    method: &'static str,
    /// Error across the line, in pulses: steps of 1/80 mm, or of 1/160 mm of both motors of
    /// the CoreXY machine.
    path_pulses: f64,
    /// Error beyond the one step that the default's motors may be off, in steps.
    plane_steps: f64,
}

/// Bounds on the Cartesian machine, where a pulse is a step.
const CARTESIAN: [Bounds; 5] = [
    // Half a step of the slower motor.
    Bounds { method: "step-bresenham", path_pulses: 0.5, plane_steps: 0.0 },
    Bounds { method: "bresenham", path_pulses: 0.5, plane_steps: 0.0 },
    Bounds { method: "point-by-point", path_pulses: 1.0, plane_steps: 0.5 },
    Bounds { method: "minimum-deviation", path_pulses: 0.5, plane_steps: 0.0 },
    // Half a step of either motor, and each of them within half a step of its law.
    Bounds { method: "dual-rate", path_pulses: 0.7072, plane_steps: -0.5 },
];

/// Bounds on the CoreXY machine, where a step of one motor is half a diagonal pulse.
const CORE_XY: [Bounds; 5] = [
    Bounds { method: "step-bresenham", path_pulses: 0.3536, plane_steps: 0.0 },
    Bounds { method: "bresenham", path_pulses: 0.3536, plane_steps: 0.0 },
    Bounds { method: "point-by-point", path_pulses: 1.0, plane_steps: 1.5 },
    // The step at the end where A + B is odd is worth as much again as the method.
    Bounds { method: "minimum-deviation", path_pulses: 1.0, plane_steps: 0.5 },
    Bounds { method: "dual-rate", path_pulses: 0.5, plane_steps: -0.5 },
];

/// Prints with a method on a machine and checks positions, intervals, laws and the path.
fn print(name: &str, machine: &str, profile: &ReferenceProfile, bounds: &Bounds) -> TraceReport {
    let text = example(name);
    let directory = directory();
    let builtin = fs::read_to_string(repository().join("config/profiles").join(format!("{machine}.toml"))).unwrap();
    let chosen = file(&directory, "profile.toml", format!("interpolation = \"{}\"\n{builtin}", bounds.method));
    let trace = directory.path().join("trace");
    let path = format!("examples/{name}");
    let outcome = ferrostep([
        "print".as_ref(),
        path.as_ref(),
        "--profile".as_ref(),
        chosen.as_os_str(),
        "--json".as_ref(),
        "--trace".as_ref(),
        trace.as_os_str(),
    ]);
    assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{outcome:#?}");
    let summary = outcome.json();
    let options = TraceCheckOptions { plane_tolerance_steps: bounds.plane_steps, ..TraceCheckOptions::default() };
    let report = check_trace(File::open(&trace).unwrap(), &text, profile, &options).unwrap();
    assert!(report.passed(), "{} on {machine}: {report}", bounds.method);
    // Each move has its end, where all motors were compared with the definitions.
    let job = interpret(&text, profile, InterpretOptions::default()).unwrap();
    assert_eq!(report.moves, job.move_count() as u64);
    assert!(report.smallest_gap_ticks.unwrap() >= 168, "{report}");
    let pulse_mm = 1.0 / profile.steps_per_mm[0].to_f64();
    let path_pulses = report.largest_path_error_mm / pulse_mm;
    let off_steps = report.largest_deviation.iter().take(2).flatten().fold(0.0, |most, one| one.steps.max(most));
    // Figures for the book: `-- --nocapture`.
    println!(
        "{} on {machine}: {path_pulses:.3} pulses, {} events, {off_steps:.3} steps off the law",
        bounds.method, report.step_events
    );
    assert!(path_pulses <= bounds.path_pulses, "{} on {machine}: {path_pulses} pulses", bounds.method);
    assert_eq!(summary["order_digest"], report.order_digest_hex());
    assert_eq!(summary["step_digest"], report.step_digest_hex());
    let motion_time_s = plan(&job, None).motion_time_s;
    let measured_s = summary["motion_time_s"].as_f64().unwrap();
    assert!((measured_s / motion_time_s - 1.0).abs() < 1e-4, "{} on {machine}: {measured_s}", bounds.method);
    for (axis, units) in ["x", "y", "z", "e"].into_iter().zip(job.logical_end_10nm) {
        let stands_mm = summary["position_mm"][axis].as_f64().unwrap();
        assert!((stands_mm - units as f64 / 100_000.0).abs() < 1e-9, "{axis} at {stands_mm}");
    }
    report
}

#[test]
fn the_cube_on_the_cartesian_machine() {
    let reports = CARTESIAN.map(|bounds| print("cube.gcode", "cartesian", &ReferenceProfile::cartesian(), &bounds));
    // The motors make the same steps; point-by-point never two at once.
    for report in &reports {
        assert_eq!(report.motor_steps, reports[0].motor_steps);
        assert!(report.step_events <= reports[2].step_events);
    }
}

#[test]
fn the_cube_on_the_core_xy_machine() {
    let reports = CORE_XY.map(|bounds| print("cube.gcode", "corexy", &ReferenceProfile::corexy(), &bounds));
    // Point-by-point turns both motors in every pulse.
    let [first, second, ..] = reports[2].motor_steps;
    assert!(first.abs_diff(second) < 5_289, "{first} {second}");
    for (report, bounds) in reports.iter().zip(&CORE_XY) {
        assert_eq!(report.motor_steps == reports[0].motor_steps, bounds.method != "point-by-point");
    }
}
