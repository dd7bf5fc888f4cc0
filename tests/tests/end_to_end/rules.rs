//! `--rules`: times by the rules of other firmwares.

use serde_json::Value;

use crate::end_to_end::command::{directory, ferrostep, file, repository};

const FOREIGN: [&str; 4] = ["klipper", "marlin-junction-deviation", "marlin-classic-jerk", "rrf"];

/// The summary of an estimate of these lines on the profile `cartesian`.
fn estimate(lines: &str, rules: &str) -> Value {
    let directory = directory();
    let job = file(&directory, "job.gcode", lines);
    let outcome = ferrostep(["estimate", job.to_str().unwrap(), "--rules", rules, "--json"]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    outcome.json()
}

fn motion_s(lines: &str, rules: &str) -> f64 {
    estimate(lines, rules)["motion_time_s"].as_f64().unwrap()
}

/// A move of 100 mm at 100 mm/s, which accelerates and brakes for 0.1 s at 1000 mm/s^2.
const MOVE: &str = "G28\nG1 X100 F6000\n";

#[test]
fn a_move_takes_its_length_and_its_ramps() {
    for rules in FOREIGN {
        let seconds = motion_s(MOVE, rules);
        assert!((seconds - 1.1).abs() < 1e-3, "{rules}: {seconds} s");
    }
}

#[test]
fn limits_in_the_file_are_read_as_each_firmware_reads_them() {
    let with = |line: &str| format!("{line}\n{MOVE}");
    // Twice the time of the ramps.
    for (line, rules) in [
        ("M204 S500", "klipper"),
        ("M204 P500 T500", "klipper"),
        ("SET_VELOCITY_LIMIT ACCEL=500", "klipper"),
        ("M204 T500", "marlin-junction-deviation"),
        ("M204 S500", "marlin-junction-deviation"),
        ("M201 X500", "marlin-junction-deviation"),
    ] {
        let seconds = motion_s(&with(line), rules);
        assert!((seconds - 1.2).abs() < 1e-3, "{line}, {rules}: {seconds} s");
    }
    // Commands that the firmware does not have, or refuses.
    for (line, rules) in [
        ("M204 P500", "klipper"),
        ("M201 X500", "klipper"),
        ("M203 X50", "klipper"),
        ("SET_VELOCITY_LIMIT ACCEL=500", "marlin-junction-deviation"),
        ("M204 P500", "marlin-junction-deviation"),
    ] {
        let seconds = motion_s(&with(line), rules);
        assert!((seconds - 1.1).abs() < 1e-3, "{line}, {rules}: {seconds} s");
    }
    let corners = "G28\nG1 X50 F6000\nG1 X50 Y50\nG1 X0 Y50\n";
    let [wide, narrow] =
        ["M205 X20 Y20", "M205 X1 Y1"].map(|line| motion_s(&format!("{line}\n{corners}"), "marlin-classic-jerk"));
    assert!(wide < narrow - 0.05, "{wide} s, {narrow} s");
}

/// The words of SET_VELOCITY_LIMIT about short moves act by Klipper's rules. A move of 2 mm with a
/// ratio of 0 is as fast as the acceleration allows.
#[test]
fn klippers_short_moves_have_their_ratio() {
    let short = "G28\nG1 X2 F6000\n";
    let with = |words: &str| motion_s(&format!("SET_VELOCITY_LIMIT {words}\n{short}"), "klipper");
    let seconds = 2.0 * (2.0f64 / 1000.0).sqrt();
    assert!((with("MINIMUM_CRUISE_RATIO=0") - seconds).abs() < 1e-3);
    // The speed is that of half the acceleration.
    let peak_mm_per_s = (2.0f64 * 500.0).sqrt();
    let slower = 2.0 / peak_mm_per_s + peak_mm_per_s / 1000.0;
    for words in ["MINIMUM_CRUISE_RATIO=0.5", "ACCEL_TO_DECEL=500", "ACCEL=1000 ACCEL_TO_DECEL=500"] {
        assert!((with(words) - slower).abs() < 1e-3, "{words}: {} s, expected {slower}", with(words));
    }
}

/// A command of limits that the firmware does not have, refuses, or takes without effect.
#[test]
fn what_the_firmware_does_not_take_has_one_remark() {
    for (line, rules, message) in [
        ("M203 X50", "klipper", "M203: Klipper has no such command, and keeps its limits"),
        ("M205 X8", "klipper", "M205: Klipper has no such command, and keeps its limits"),
        ("M204 P500", "klipper", "M204: Klipper refuses it, and keeps its limits"),
        (
            "SET_VELOCITY_LIMIT MINIMUM_CRUISE_RATIO=2",
            "klipper",
            "SET_VELOCITY_LIMIT: Klipper refuses it, and keeps its limits",
        ),
        ("M205 X8", "marlin-junction-deviation", "M205: its words change no limit of Marlin with junction deviation"),
        (
            "SET_VELOCITY_LIMIT ACCEL=500",
            "rrf",
            "SET_VELOCITY_LIMIT: RepRapFirmware has no such command, and keeps its limits",
        ),
    ] {
        let summary = estimate(&format!("{line}\n{MOVE}{line}\n"), rules);
        let remarks = summary["remarks"].as_array().unwrap();
        assert_eq!(remarks.len(), 1, "{line}, {rules}: {summary}");
        assert_eq!(remarks[0], serde_json::json!({"kind": "foreign", "message": message, "count": 2, "lines": [1, 4]}));
    }
    for (line, rules) in [
        ("M203 X50", "rrf"),
        ("M205 X8", "marlin-classic-jerk"),
        ("SET_VELOCITY_LIMIT ACCEL=500 ACCEL_TO_DECEL=250", "klipper"),
    ] {
        let summary = estimate(&format!("{line}\n{MOVE}"), rules);
        assert_eq!(summary["remarks"], serde_json::json!([]), "{line}, {rules}");
    }
}

/// The time of a print whose file has half the acceleration is explained by half
/// the acceleration.
#[test]
fn a_measured_time_is_explained() {
    let directory = directory();
    let zigzag: String = (0..40).map(|y| format!("G1 X{} Y{y} F9000\n", if y % 2 == 0 { 60 } else { 10 })).collect();
    let job = file(&directory, "job.gcode", format!("G28\nM204 P1000 T1000\n{zigzag}"));
    let slower = file(&directory, "slower.gcode", format!("G28\nM204 P500 T500\n{zigzag}"));
    let took = |job: &std::path::Path, rules: &str, time: &str| {
        let arguments = ["estimate", job.to_str().unwrap(), "--rules", rules, "--took", time, "--json"];
        let outcome = ferrostep(arguments);
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        outcome.json()
    };
    for rules in FOREIGN {
        let measured_s = took(&slower, rules, "1h")["print_time_s"].as_f64().unwrap();
        let summary = took(&job, rules, &format!("{measured_s}s"));
        let explained = summary["took"]["explained_by"].as_array().unwrap();
        let factors: Vec<f64> = explained.iter().map(|one| one["factor"].as_f64().unwrap()).collect();
        let sizes: Vec<f64> = factors.iter().map(|factor| factor.ln().abs()).collect();
        assert!(sizes.is_sorted(), "{summary:#}");
        let acceleration = explained.iter().find(|one| one["limit"] == "acceleration").unwrap();
        assert!((acceleration["factor"].as_f64().unwrap() - 0.5).abs() < 0.03, "{rules}: {summary:#}");
        assert!(explained.iter().any(|one| one["limit"] == "asked speed"), "{rules}: {summary:#}");
    }
    let own = took(&job, "own", "1h");
    assert_eq!(own["took"]["explained_by"], serde_json::json!([]), "{own:#}");
    let same = took(&job, "klipper", &format!("{}s", own["print_time_s"]));
    assert!(same["took"]["difference_s"].as_f64().unwrap().abs() < 60.0, "{same:#}");
    let outcome = ferrostep(["estimate", job.to_str().unwrap(), "--took", "soon"]);
    assert_eq!(outcome.status, Some(2));
    assert!(outcome.stderr.contains("expected 5h01"), "{}", outcome.stderr);
}

#[test]
fn waits_and_homing_take_the_time_of_every_estimate() {
    let lines = "M140 S50\nM104 S200\nG28\nM190 S50\nM109 S200\nG4 P2500\nG1 X50 E2 F3000\nG28 X\nG1 Y30\n";
    let rest_s =
        |summary: &Value| summary["print_time_s"].as_f64().unwrap() - summary["motion_time_s"].as_f64().unwrap();
    let own = rest_s(&estimate(lines, "own"));
    for rules in FOREIGN {
        let other = rest_s(&estimate(lines, rules));
        assert!((own - other).abs() < 0.5, "{rules}: {other} s, own {own} s");
    }
}

#[test]
fn the_position_and_the_filament_are_those_of_every_estimate() {
    let lines = "M302 P1\nG28\nG91\nG1 X20 Y10 F6000\nG2 X10 Y0 I5 J0 E1\nG90\nG92 X5\nG1 X10\nG10\nG11\nG20\nG1 X2\n";
    let own = estimate(lines, "own");
    for rules in FOREIGN {
        let other = estimate(lines, rules);
        for key in ["position_mm", "filament_mm", "moves", "lines"] {
            assert_eq!(own[key], other[key], "{rules}: {key}");
        }
    }
}

/// Without rules nothing is new; with them the summary names them, and their limits share
/// all of the motion.
#[test]
fn the_summary_says_by_which_rules_and_what_held() {
    let own = estimate(MOVE, "own");
    assert!(own["rules"].is_null() && own["limits"].is_null(), "{own}");
    for rules in FOREIGN {
        let summary = estimate(MOVE, rules);
        assert_eq!(summary["rules"], rules);
        let limits = summary["limits"].as_array().unwrap();
        let seconds: f64 = limits.iter().map(|limit| limit["seconds"].as_f64().unwrap()).sum();
        assert!((seconds - summary["motion_time_s"].as_f64().unwrap()).abs() < 1e-9, "{summary}");
        assert_eq!(limits[0]["limit"], "asked speed");
        assert_eq!(limits[0]["moves"], 1);
    }
    let cube = repository().join("examples/cube.gcode");
    let outcome = ferrostep(["estimate", cube.to_str().unwrap(), "--rules", "klipper"]);
    for expected in ["  planned by   klipper", "  limited by   ", "acceleration: "] {
        assert!(outcome.stdout.contains(expected), "{}", outcome.stdout);
    }
}

#[test]
fn a_sweep_follows_the_rules_of_an_imported_profile() {
    let directory = directory();
    let configuration = repository().join("tests/cases/klipper-times/voron-2.cfg");
    let imported = ferrostep_import::read(&configuration, false).unwrap();
    let profile = file(&directory, "voron.toml", &imported.profile);
    let cube = repository().join("examples/cube.gcode");
    let sweep = |key: &str| {
        let arguments = ["sweep", cube.to_str().unwrap(), "--profile", profile.to_str().unwrap(), "--json"];
        let outcome = ferrostep(arguments.into_iter().chain(key.split(' ')));
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        let swept = outcome.json();
        assert_eq!(swept["rules"], "klipper");
        let rows = swept["rows"].as_array().unwrap();
        rows.iter().map(|row| row["print_time_s"].as_f64().unwrap()).collect::<Vec<_>>()
    };
    let [slow, fast] = sweep("--acceleration 1000,4000")[..] else { panic!("expected two times") };
    assert!(fast < slow - 10.0, "{slow} s, {fast} s");
    let [none, most] = sweep("--set rules.minimum_cruise_ratio=0,0.9")[..] else { panic!("expected two times") };
    assert!(none < most - 1.0, "{none} s, {most} s");
}

#[test]
fn import_names_the_rules_of_the_firmware() {
    for (name, rules) in [("bed-slinger.cfg", "klipper"), ("Configuration.h", "marlin-classic-jerk")] {
        let outcome = ferrostep(["import", &format!("tests/configurations/{name}"), "--json"]);
        let profile: toml::Table = outcome.json()["profile"].as_str().unwrap().parse().unwrap();
        assert_eq!(profile["rules"]["planned_by"].as_str(), Some(rules), "{name}");
    }
}

#[test]
fn unknown_rules_and_wrong_keys_are_refused() {
    let outcome = ferrostep(["estimate", "examples/cube.gcode", "--rules", "smoothieware"]);
    assert_eq!(outcome.status, Some(2));
    assert!(outcome.stderr.contains("marlin-classic-jerk"), "{}", outcome.stderr);
    let directory = directory();
    let base = std::fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    for (key, expected) in [
        ("minimum_cruise_ratio = 1.0", "rules.minimum_cruise_ratio = 1.0: expected 0 to 0.99"),
        ("planned_by = \"smoothieware\"", "rules.planned_by"),
        ("queued_moves = 3", "rules.queued_moves"),
    ] {
        let profile = file(&directory, "wrong.toml", format!("{base}\n[rules]\n{key}\n"));
        let outcome = ferrostep(["estimate", "examples/cube.gcode", "--profile", profile.to_str().unwrap()]);
        assert_eq!(outcome.status, Some(2), "{outcome:#?}");
        assert!(outcome.stderr.contains(expected), "{}", outcome.stderr);
    }
}
