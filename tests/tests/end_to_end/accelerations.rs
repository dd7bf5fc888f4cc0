//! Whole prints under each law of acceleration.

use std::fs::File;

use ferrostep_oracle::reference::{InterpretOptions, ReferenceProfile, interpret};
use ferrostep_oracle::trace_check::{Finding, TraceCheckOptions, check_trace};
use ferrostep_planner::AccelerationProfile;
use ferrostep_printer::Profile;
use ferrostep_session::desk::{LOOK_AHEAD_BLOCKS, MotionState};
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::{JobReplies, Session};

use crate::end_to_end::command::{directory, example, ferrostep, file};
use crate::end_to_end::desk::profile;

/// The reference checks the steps: the motors' positions at each move's end, the distance of
/// events, the speed and acceleration of the axes. Its own law is the trapezoid; the planner's
/// tests check that these laws are kept.
fn options() -> TraceCheckOptions {
    TraceCheckOptions { duration_tolerance: f64::INFINITY, law_tolerance_steps: f64::INFINITY, ..Default::default() }
}

#[track_caller]
fn check(name: &str, law: AccelerationProfile) {
    let text = example(name);
    let directory = directory();
    let machine =
        format!("acceleration = \"{}\"\n{}", law.name(), ferrostep_profiles::builtin_text("cartesian").unwrap());
    let machine = file(&directory, "machine.toml", machine);
    let trace = directory.path().join("trace");
    let path = format!("examples/{name}");
    let outcome = ferrostep([
        "print".as_ref(),
        path.as_ref(),
        "--profile".as_ref(),
        machine.as_os_str(),
        "--json".as_ref(),
        "--trace".as_ref(),
        trace.as_os_str(),
    ]);
    assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{outcome:#?}");
    let summary = outcome.json();
    let reference = ReferenceProfile::cartesian();
    let options = TraceCheckOptions { findings_kept: usize::MAX, ..options() };
    let report = check_trace(File::open(&trace).unwrap(), &text, &reference, &options).unwrap();
    // A table's start frequency is a jump in speed, which any block may begin with.
    let jumps = |finding: &&Finding| matches!(finding, Finding::JumpsTooFar { .. });
    let by_design =
        if law == AccelerationProfile::SCurveTable { report.findings.iter().filter(jumps).count() } else { 0 };
    assert_eq!(report.finding_count, by_design as u64, "{report}");
    let job = interpret(&text, &reference, InterpretOptions::default()).unwrap();
    assert_eq!(report.moves, job.move_count() as u64);
    for key in ["underruns", "starvation_flushes", "clamped_moves"] {
        assert_eq!(summary[key], 0, "{key}");
    }
    for (axis, units) in ["x", "y", "z", "e"].into_iter().zip(job.logical_end_10nm) {
        let stands = summary["position_mm"][axis].as_f64().unwrap();
        assert!((stands - units as f64 / 1e5).abs() < 1e-9, "{axis}: {stands}");
    }
    for (axis, steps) in ["x", "y", "z", "e"].into_iter().zip(report.motor_steps) {
        assert_eq!(summary["motor_steps"][axis], steps, "{axis}");
    }
    let estimate =
        ferrostep(["estimate".as_ref(), path.as_ref(), "--profile".as_ref(), machine.as_os_str(), "--json".as_ref()]);
    assert_eq!(estimate.json()["motion_time_s"], summary["motion_time_s"]);
}

#[test]
fn a_cube_with_s_curves_passes_the_trace_check() {
    check("cube.gcode", AccelerationProfile::SCurve);
}

#[test]
fn a_cube_with_a_frequency_table_passes_the_trace_check() {
    check("cube.gcode", AccelerationProfile::SCurveTable);
}

#[test]
fn a_gyroid_with_s_curves_passes_the_trace_check() {
    check("gyroid.gcode.gz", AccelerationProfile::SCurve);
}

#[test]
fn a_gyroid_with_a_frequency_table_passes_the_trace_check() {
    check("gyroid.gcode.gz", AccelerationProfile::SCurveTable);
}

#[test]
fn a_cube_with_five_segments_passes_the_trace_check() {
    check("cube.gcode", AccelerationProfile::SCurveFiveSegments);
}

/// Motion time of a file, s.
fn motion_s(machine: &str, name: &str, law: AccelerationProfile, block_by_block: bool) -> f64 {
    let mut machine = profile(machine);
    machine.motion.acceleration = law;
    seconds_of_motion(machine, name, block_by_block)
}

fn seconds_of_motion(machine: Profile, name: &str, block_by_block: bool) -> f64 {
    let replies = JobReplies::new(|text: &str| panic!("{text}"));
    let session = Session::estimate(machine, LOOK_AHEAD_BLOCKS, replies);
    assert!(!block_by_block || session.desk().plan_block_by_block());
    let mut progress = JobProgress::default();
    let mut printer = session.printer();
    session.run(job::run(&mut example(name).as_slice(), &mut printer, &mut progress, |_| {})).unwrap();
    session.figures().motion_time_s
}

/// The gain of one law over several blocks, compared with zero acceleration at the
/// end of every block.
#[test]
fn s_curves_over_several_blocks_gain_most_in_curves() {
    for (machine, name, least) in [
        ("cartesian", "cube.gcode", 0.01),
        ("cartesian", "gyroid.gcode.gz", 0.08),
        ("corexy", "arcs-corexy.gcode.gz", 0.1),
    ] {
        let trapezoid = motion_s(machine, name, AccelerationProfile::Trapezoid, false);
        let alone = motion_s(machine, name, AccelerationProfile::SCurve, true);
        let shared = motion_s(machine, name, AccelerationProfile::SCurve, false);
        let table = motion_s(machine, name, AccelerationProfile::SCurveTable, false);
        let five = motion_s(machine, name, AccelerationProfile::SCurveFiveSegments, false);
        println!(
            "{name}: trapezoid {trapezoid:.1} s, five segments {five:.1} s, block by block {alone:.1} s, \
             shared {shared:.1} s, table {table:.1} s"
        );
        // Moves of a millimetre hardly reach their full acceleration at 300 000 mm/s^3.
        assert!(alone < five * 1.001, "{name}: {alone} {five}");
        assert!(trapezoid < shared && shared <= alone * (1.0 - least), "{name}: {trapezoid} {shared} {alone}");
    }
}

/// S-curves at a jerk that takes 8 ms to the greatest acceleration cost little over the trapezoid.
/// The cost is in corners that limit the speed: there the acceleration has to be zero, unlike a
/// trapezoid's. The arcs have one each millimetre.
#[test]
fn s_curves_of_8_ms_cost_what_their_corners_do() {
    for (machine, name, acceleration, most) in [
        ("cartesian", "cube.gcode", 1_000.0, 0.02),
        ("cartesian", "gyroid.gcode.gz", 1_000.0, 0.05),
        ("corexy", "arcs-corexy.gcode.gz", 10_000.0, 0.16),
    ] {
        let trapezoid = motion_s(machine, name, AccelerationProfile::Trapezoid, false);
        let mut machine = profile(machine);
        machine.motion.acceleration = AccelerationProfile::SCurve;
        machine.motion.jerk_mm_per_s3 = acceleration / 0.008;
        let s_curve = seconds_of_motion(machine, name, false);
        println!("{name}: trapezoid {trapezoid:.1} s, S-curve {s_curve:.1} s");
        assert!(trapezoid < s_curve && s_curve <= trapezoid * (1.0 + most), "{name}: {trapezoid} {s_curve}");
    }
}
