//! Files of real slicers; the reference checks every step of their prints.

use std::collections::VecDeque;
use std::fs::{self, File};
use std::path::Path;

use ferrostep_oracle::reference::{InterpretOptions, Job, ReferenceProfile, interpret, plan};
use ferrostep_oracle::trace::{Record, TraceReader};
use ferrostep_oracle::trace_check::{TraceCheckOptions, TraceReport, check_trace};
use ferrostep_random_cases::share_of;
use serde_json::Value;

use crate::end_to_end::command::{directory, example, ferrostep, file, repository};

fn reference_profile(name: &str) -> ReferenceProfile {
    match name {
        "cartesian" => ReferenceProfile::cartesian(),
        "corexy" => ReferenceProfile::corexy(),
        other => panic!("no reference for {other}"),
    }
}

#[track_caller]
fn near(what: &str, value: &Value, expected: f64, tolerance: f64) {
    let value = value.as_f64().unwrap_or_else(|| panic!("{what} is {value}, expected a number"));
    assert!((value - expected).abs() <= tolerance, "{what} is {value}, expected {expected} +- {tolerance}");
}

/// The keys that outside tools rely on, and their types.
fn check_keys(summary: &Value) {
    for key in ["file", "profile"] {
        assert!(summary[key].is_string(), "{key}: {}", summary[key]);
    }
    for key in ["lines", "moves", "clamped_moves", "max_event_rate_hz", "underruns", "starvation_flushes"] {
        assert!(summary[key].is_u64(), "{key}: {}", summary[key]);
    }
    for key in ["print_time_s", "motion_time_s", "filament_mm", "wall_s", "realtime_factor"] {
        assert!(summary[key].is_number(), "{key}: {}", summary[key]);
    }
    for key in ["order_digest", "step_digest"] {
        let digest = summary[key].as_str().unwrap();
        assert!(digest.len() == 16 && u64::from_str_radix(digest, 16).is_ok(), "{key}: {digest}");
    }
    assert!(summary["unknown_commands"].as_array().unwrap().iter().all(Value::is_string));
    for axis in ["x", "y", "z", "e"] {
        assert!(summary["motor_steps"][axis].is_u64(), "{axis}: {}", summary["motor_steps"]);
        assert!(summary["position_mm"][axis].is_number(), "{axis}: {}", summary["position_mm"]);
    }
    let (motion, wall) = (summary["motion_time_s"].as_f64().unwrap(), summary["wall_s"].as_f64().unwrap());
    near("realtime_factor", &summary["realtime_factor"], motion / wall, 0.01 * motion / wall);
    assert!(summary["print_time_s"].as_f64().unwrap() > motion, "homing and heating take time too");
}

/// Maximum number of step events in any millisecond of a trace, times 1000.
fn most_events_hz(trace: &Path) -> u64 {
    let reader = TraceReader::new(File::open(trace).unwrap()).unwrap();
    let window_ticks = reader.header().tick_hz / 1000;
    let (mut window, mut most) = (VecDeque::new(), 0);
    for record in reader {
        if let Record::Step(event) = record.unwrap() {
            window.push_back(event.tick);
            while window.front().is_some_and(|first| event.tick - first >= window_ticks) {
                window.pop_front();
            }
            most = most.max(window.len());
        }
    }
    most as u64 * 1000
}

fn check_summary(summary: &Value, job: &Job, report: &TraceReport) {
    assert_eq!(summary["unknown_commands"], serde_json::json!([]));
    for key in ["underruns", "starvation_flushes", "clamped_moves"] {
        assert_eq!(summary[key], 0, "{key}");
    }
    assert_eq!(summary["lines"], job.lines);
    assert_eq!(summary["moves"], job.move_count());
    assert_eq!(report.moves, job.move_count() as u64);
    near("filament_mm", &summary["filament_mm"], job.filament_mm(), 1e-6);
    for (axis, units) in ["x", "y", "z", "e"].into_iter().zip(job.logical_end_10nm) {
        near(axis, &summary["position_mm"][axis], units as f64 / 100_000.0, 1e-9);
    }
    for (axis, steps) in ["x", "y", "z", "e"].into_iter().zip(report.motor_steps) {
        assert_eq!(summary["motor_steps"][axis], steps, "{axis}");
    }
    assert_eq!(summary["order_digest"], report.order_digest_hex());
    assert_eq!(summary["step_digest"], report.step_digest_hex());
}

/// Prints an example and makes all checks.
#[track_caller]
fn check(name: &str, profile_name: &str) {
    let text = example(name);
    let profile = reference_profile(profile_name);
    let job = interpret(&text, &profile, InterpretOptions::default()).unwrap();
    let motion_time_s = plan(&job, None).motion_time_s;
    let directory = directory();
    let trace = directory.path().join("trace");
    let path = format!("examples/{name}");
    let mut motor_steps = Vec::new();
    // The look-ahead: the board's for every file, a long one for this run's share of them.
    let is_shared = share_of(LISTED.len() as u64).any(|file| LISTED[file as usize] == name);
    for look_ahead in ["128"].into_iter().chain(is_shared.then_some("4096")) {
        let outcome = ferrostep(
            ["print", &path, "--profile", profile_name, "--look-ahead", look_ahead, "--json", "--trace"]
                .into_iter()
                .map(AsRef::as_ref)
                .chain([trace.as_os_str()]),
        );
        assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{outcome:#?}");
        let summary = outcome.json();
        check_keys(&summary);
        assert_eq!((&summary["file"], &summary["profile"]), (&path.as_str().into(), &profile_name.into()));
        assert_eq!(summary.get("stopped"), None);
        near("motion_time_s", &summary["motion_time_s"], motion_time_s, 1e-4 * motion_time_s);
        assert_eq!(summary["max_event_rate_hz"], most_events_hz(&trace));
        let report = check_trace(File::open(&trace).unwrap(), &text, &profile, &TraceCheckOptions::default()).unwrap();
        assert!(report.passed(), "{report}");
        check_summary(&summary, &job, &report);
        motor_steps.push(report.motor_steps);
    }
    // The path is the same for any look-ahead.
    assert_eq!(motor_steps.first(), motor_steps.last());

    let estimate = ferrostep(["estimate", &path, "--profile", profile_name, "--json"]);
    assert_eq!(estimate.status, Some(0), "{estimate:#?}");
    let estimate = estimate.json();
    near("estimated motion_time_s", &estimate["motion_time_s"], motion_time_s, 1e-4 * motion_time_s);
    near("estimated filament_mm", &estimate["filament_mm"], job.filament_mm(), 1e-6);
    assert_eq!(estimate["moves"], job.move_count());
    assert_eq!(estimate.get("motor_steps"), None);
}

/// A test for each file, so that a failure names it.
macro_rules! prints {
    ($($test:ident: $name:literal on $profile:literal;)+) => {
        $(#[test]
        fn $test() {
            check($name, $profile);
        })+

        const LISTED: &[&str] = &[$($name),+];

        /// A file that is added to the examples must be printed here too.
        #[test]
        fn every_example_is_listed() {
            let mut listed = LISTED.to_vec();
            listed.sort_unstable();
            let found = fs::read_dir(repository().join("examples")).unwrap();
            let mut found: Vec<_> = found.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
            found.retain(|name| name.contains(".gcode"));
            found.sort_unstable();
            assert_eq!(listed, found);
        }
    };
}

prints! {
    arcs_corexy: "arcs-corexy.gcode.gz" on "corexy";
    cube_corexy: "cube-corexy.gcode.gz" on "corexy";
    cube_cura: "cube-cura.gcode.gz" on "cartesian";
    cube_slic3r: "cube-slic3r.gcode.gz" on "cartesian";
    cube: "cube.gcode" on "cartesian";
    firmware_retraction: "firmware-retraction.gcode.gz" on "cartesian";
    four_cubes_labelled: "four-cubes-labelled.gcode.gz" on "cartesian";
    gyroid: "gyroid.gcode.gz" on "cartesian";
    supports: "supports.gcode.gz" on "cartesian";
    vase: "vase.gcode.gz" on "cartesian";
}

/// A job without the lines that change limits.
fn without_limits(text: &[u8]) -> Vec<u8> {
    let changes_limits = |line: &[u8]| (201..=205).any(|code| line.starts_with(format!("M{code}").as_bytes()));
    text.split_inclusive(|&byte| byte == b'\n').filter(|line| !changes_limits(line)).flatten().copied().collect()
}

/// Times that agree with another planner's for the same limits.
#[test]
fn estimates_match_the_reference_planner() {
    let directory = directory();
    let cartesian = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let changed = cartesian.replace("junction_deviation_mm = 0.1\n", "junction_deviation_mm = 0.0995\n");
    assert_ne!(changed, cartesian);
    let profile = file(&directory, "profile.toml", changed);
    for (name, motion_time_s) in [("cube.gcode", 1270.85), ("vase.gcode.gz", 7730.08)] {
        let text = example(name);
        let stripped = without_limits(&text);
        assert!(stripped.len() < text.len(), "{name} changes limits");
        let job = file(&directory, "job.gcode", stripped);
        for command in ["print", "estimate"] {
            let outcome = ferrostep([
                command.as_ref(),
                job.as_os_str(),
                "--profile".as_ref(),
                profile.as_ref(),
                "--json".as_ref(),
            ]);
            assert_eq!(outcome.status, Some(0), "{outcome:#?}");
            near(name, &outcome.json()["motion_time_s"], motion_time_s, 1e-4 * motion_time_s);
        }
    }
}

/// The summary without `--json` is for people, and its figures are the same.
#[test]
fn the_summary_is_readable() {
    let outcome = ferrostep(["print", "examples/cube.gcode"]);
    let summary = ferrostep(["print", "examples/cube.gcode", "--json"]).json();
    assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{outcome:#?}");
    for key in ["step_digest", "order_digest"] {
        assert!(outcome.stdout.contains(summary[key].as_str().unwrap()), "{key} in {}", outcome.stdout);
    }
    assert!(outcome.stdout.contains(&format!("{} in {} lines", summary["moves"], summary["lines"])), "{outcome:#?}");
}

/// The output shown in the book is the command's, all but the speed of the computer.
#[test]
fn the_books_samples_match_the_command() {
    let page = "docs/src/first-print.md";
    let text = fs::read_to_string(repository().join(page)).unwrap();
    let outcome = ferrostep(["print", "examples/cube.gcode"]);
    for line in outcome.stdout.lines().filter(|line| !line.contains("real time")) {
        assert!(text.contains(line), "{page} lacks {line:?}");
    }
}
