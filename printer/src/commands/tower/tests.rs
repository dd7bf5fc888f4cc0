//! A value that changes with the height, on a machine.
#![allow(clippy::unwrap_used)]

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use ferrostep_gcode::{Decimal, TowerCourse, parse};
use proptest::prelude::*;

use super::*;
use crate::motion::homing::tests::rig::{Rig, RigPrinter, execute};

/// A printer that may extrude.
fn printing(rig: &Rig) -> RigPrinter<'_> {
    let mut printer = rig.printer();
    for line in ["M302 P1", "G90", "M83"] {
        execute(&mut printer, line).unwrap();
    }
    printer
}

/// Returns the value set at each of these heights, where a short line is printed.
fn at_heights(tower: &str, heights: &[&str], set: impl Fn(&RigPrinter<'_>, &Rig) -> f64) -> Vec<f64> {
    let rig = Rig::new(|_| {});
    let mut printer = printing(&rig);
    execute(&mut printer, tower).unwrap();
    let mut values = Vec::new();
    for (height, x) in heights.iter().zip(1..) {
        execute(&mut printer, &format!("G1 Z{height}")).unwrap();
        execute(&mut printer, &format!("G1 X{x} E0.1")).unwrap();
        values.push(set(&printer, &rig));
    }
    values
}

fn advance(_: &RigPrinter<'_>, rig: &Rig) -> f64 {
    rig.choice().pressure_advance.seconds
}

#[test]
fn each_course_follows_its_formula() {
    let heights = ["0.2", "2.4", "2.6", "4.9", "5", "10.1"];
    for (words, expected) in [
        ("START=0.01 FACTOR=.005", [0.011, 0.022, 0.023, 0.0345, 0.035, 0.0605]),
        ("START=0 FACTOR=.005 BAND=5", [0.0125, 0.0125, 0.0125, 0.0125, 0.0375, 0.0625]),
        ("START=0.1 STEP_DELTA=-.02 STEP_HEIGHT=2.5", [0.1, 0.1, 0.08, 0.08, 0.06, 0.02]),
        ("START=0.01 FACTOR=.01 SKIP=2.5", [0.01, 0.01, 0.011, 0.034, 0.035, 0.086]),
    ] {
        let tower = format!("TUNING_TOWER COMMAND=M900 PARAMETER=K {words}");
        assert_eq!(at_heights(&tower, &heights, advance), expected, "{words}");
    }
}

#[test]
fn every_live_value_has_its_tower() {
    type Set = fn(&RigPrinter<'_>, &Rig) -> f64;
    let cases: [(&str, &str, Set); 16] = [
        ("SET_PRESSURE_ADVANCE", "ADVANCE", advance),
        ("M572", "S", advance),
        ("\"M572 S0.5 T3\"", "L", |_, rig| rig.choice().pressure_advance.above.map_or(0.0, |above| above.seconds)),
        ("M593", "D", |_, rig| rig.choice().shapers[1].damping),
        ("'SET_INPUT_SHAPER SHAPER_TYPE=\"zv\"'", "DAMPING_RATIO_X", |_, rig| rig.choice().shapers[0].damping),
        ("M140", "S", |printer, _| printer.modes.targets_celsius[1].into()),
        ("M104", "s", |printer, _| printer.modes.targets_celsius[0].into()),
        ("'SET_HEATER_TEMPERATURE HEATER=extruder'", "TARGET", |printer, _| printer.modes.targets_celsius[0].into()),
        ("M220", "S", |printer, _| printer.interpreter.modal.feed_percent.into()),
        ("m221", "S", |printer, _| printer.interpreter.modal.flow_percent.into()),
        ("M204", "P", |_, rig| rig.limits().print_acceleration_mm_per_s2),
        ("SET_VELOCITY_LIMIT", "ACCEL", |_, rig| rig.limits().travel_acceleration_mm_per_s2),
        ("M205", "J", |_, rig| rig.limits().junction_deviation_mm),
        ("M203", "Y", |_, rig| rig.limits().max_feed_mm_per_s[1]),
        ("M207", "S", |printer, _| printer.interpreter.modal.retraction.length_10nm as f64 / 100_000.0),
        ("M208", "S", |printer, _| printer.interpreter.modal.retraction.extra_recover_10nm as f64 / 100_000.0),
    ];
    for (command, parameter, set) in cases {
        // Whole numbers for percents and temperatures.
        let (start, factor) = match parameter {
            "K" | "L" | "D" | "DAMPING_RATIO_X" | "ADVANCE" => ("0.1", "0.1"),
            "S" if command == "M572" => ("0.1", "0.1"),
            "s" | "S" | "TARGET" if !command.starts_with("M2") => ("20", "5"),
            _ => ("2", "1"),
        };
        let tower = format!("TUNING_TOWER COMMAND={command} PARAMETER={parameter} START={start} FACTOR={factor}");
        let [start, factor] = [start, factor].map(|number| number.parse::<f64>().unwrap());
        let set = at_heights(&tower, &["1", "2"], set);
        for (value, height) in set.iter().zip([1.0, 2.0]) {
            let expected = start + factor * height;
            assert!((value - expected).abs() < 1e-6, "{tower}: {set:?}, expected {expected} at {height}");
        }
    }
}

/// A travel, a lift, a retraction, an extrusion in the air and a repeated height do not change the
/// value.
#[test]
fn only_lines_that_print_at_a_new_height_change_it() {
    let rig = Rig::new(|_| {});
    let mut printer = printing(&rig);
    execute(&mut printer, "TUNING_TOWER COMMAND=M900 PARAMETER=K START=0.01 FACTOR=.01").unwrap();
    for (line, expected) in [
        ("G1 Z1", 0.0),
        ("G1 X5", 0.0),
        ("G1 E1", 0.0),
        ("G1 X6 E-1", 0.0),
        ("G1 X7 E1", 0.02),
        ("M900 K0.5", 0.5),
        ("G1 X8 E1", 0.5),
        ("G1 Z3", 0.5),
        ("G1 Z1", 0.5),
        ("G1 X9 E1", 0.5),
        ("G1 Z1.5 E1", 0.025),
        ("G2 I5 Z2 E1", 0.03),
        ("G92 Z0", 0.03),
        ("G1 X10 E1", 0.03),
        ("G1 Z1 X9 E1", 0.02),
    ] {
        execute(&mut printer, line).unwrap();
        assert_eq!(rig.choice().pressure_advance.seconds, expected, "{line}");
    }
}

#[test]
fn a_tower_waits_for_its_print_and_ends_with_it() {
    let tower = "TUNING_TOWER COMMAND=M900 PARAMETER=K START=0.01 FACTOR=.01";
    for (ends, why) in [
        ("G28", "the print has ended"),
        ("G28 Z", "the print has ended"),
        ("M110 N0", "the print has ended"),
        ("G1 X20 Z1 E1", "the print continues lower"),
    ] {
        let rig = Rig::new(|_| {});
        let mut printer = printing(&rig);
        for line in [tower, "M110 N0", "G28", "G1 Z3.5", "G28 X", "G1 X10 E1"] {
            execute(&mut printer, line).unwrap();
        }
        assert!(printer.print.tower.is_some(), "{ends}");
        let set = rig.choice();
        rig.last_texts();
        execute(&mut printer, ends).unwrap();
        assert!(printer.print.tower.is_none(), "{ends}");
        assert_eq!(rig.last_texts(), [format!("echo:TUNING_TOWER has ended: {why}")]);
        assert_eq!(rig.choice(), set, "the value stays after {ends}");
    }
}

#[test]
fn a_query_answers_with_the_command_that_sets_it() {
    for tower in [
        "TUNING_TOWER COMMAND=\"M900\" PARAMETER=K START=0.01 SKIP=0 FACTOR=-0.005",
        "TUNING_TOWER COMMAND=\"M593 X\" PARAMETER=F START=30 SKIP=2.5 FACTOR=1 BAND=5",
        "TUNING_TOWER COMMAND='SET_HEATER_TEMPERATURE HEATER=\"extruder\"' PARAMETER=TARGET START=260 SKIP=0 STEP_DELTA=-5 \
         STEP_HEIGHT=5",
    ] {
        let rig = Rig::new(|_| {});
        let mut printer = printing(&rig);
        execute(&mut printer, tower).unwrap();
        execute(&mut printer, "TUNING_TOWER").unwrap();
        assert_eq!(rig.last_texts(), [format!("echo:{tower}")]);
    }
    let rig = Rig::new(|_| {});
    let mut printer = printing(&rig);
    execute(&mut printer, "TUNING_TOWER").unwrap();
    assert_eq!(rig.last_texts(), ["echo:TUNING_TOWER: none"]);
    for line in ["TUNING_TOWER COMMAND=M900 PARAMETER=K START=0 FACTOR=.005", "G1 Z2", "G1 X1 E1", "TUNING_TOWER"] {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!(rig.last_texts().last().unwrap(), "echo:TUNING_TOWER at Z2.00: M900 K0.01");
}

fn refused(line: &str) -> String {
    let rig = Rig::new(|_| {});
    let mut printer = printing(&rig);
    let set = "TUNING_TOWER COMMAND=M900 PARAMETER=K START=0.5 FACTOR=0";
    execute(&mut printer, set).unwrap();
    let failure = execute(&mut printer, line).unwrap_err().to_string();
    let kept = printer.print.tower.as_ref().map(|tower| tower.start);
    assert_eq!(kept, Some(Decimal::from_nanos(500_000_000)), "the tower before stays: {line}");
    failure
}

#[test]
fn what_is_no_live_value_is_refused_by_its_name() {
    for command in ["G1", "M109", "G28", "M112", "TUNING_TOWER", "M106 P1", "M906"] {
        let line = format!("TUNING_TOWER COMMAND=\"{command}\" PARAMETER=S START=0 FACTOR=1");
        let says = refused(&line);
        assert!(says.starts_with(&format!("COMMAND: {command} sets no value of a print, expected M104")), "{says}");
    }
    for (command, parameter) in [
        ("M900", "T"),
        ("M900", "S"),
        ("M900", ""),
        ("M900", "KK"),
        ("M900", "K0.1 L"),
        ("M572", "L"),
        ("M593", "P"),
        ("M593", "X"),
        ("M104", "T"),
        ("\"M104 S200 ;\"", "S"),
        ("\"M104 S200 (\"", "S"),
        ("\"M104 S200 *\"", "S"),
        ("\"M104 S200 M5\"", "S"),
        ("M221", "T"),
        ("M204", "Q"),
        ("M106", "P"),
        ("SET_VELOCITY_LIMIT", "ACCEL_TO_DECEL"),
        ("SET_PRESSURE_ADVANCE", "EXTRUDER"),
        ("SET_INPUT_SHAPER", "SHAPER_FREQ_Z"),
        ("SET_HEATER_TEMPERATURE", "TARGET"),
    ] {
        let line = format!("TUNING_TOWER COMMAND={command} PARAMETER=\"{parameter}\" START=0 FACTOR=1");
        let says = refused(&line);
        assert!(
            says.starts_with(&format!("PARAMETER: this command has no plain number {parameter}")),
            "{line}: {says}"
        );
    }
    let long = "0".repeat(60);
    let says = refused(&format!("TUNING_TOWER COMMAND=\"M900 T{long}\" PARAMETER=K START=0 FACTOR=1"));
    assert_eq!(says, "COMMAND and PARAMETER: expected at most 64 characters");
}

/// The print does not stop, and a refused value is not tried at each layer.
#[test]
fn a_value_that_the_command_refuses_ends_the_tower_and_not_the_print() {
    for (tower, good, refusal) in [
        ("COMMAND=M900 PARAMETER=K START=1 FACTOR=1", 2.0, "\"M900 K3\": "),
        ("COMMAND=M207 PARAMETER=S START=2 FACTOR=-1", 0.0, "\"M207 S-1\": S: -1 is out of range, expected 0 or more"),
    ] {
        let rig = Rig::new(|_| {});
        let mut printer = printing(&rig);
        execute(&mut printer, &format!("TUNING_TOWER {tower}")).unwrap();
        rig.last_texts();
        for line in ["G1 Z1", "G1 X1 E1", "G1 Z2", "G1 X2 E1", "G1 Z3", "G1 X3 E1", "G1 Z4", "G1 X4 E1"] {
            execute(&mut printer, line).unwrap();
        }
        let said: Vec<String> = rig.last_texts().into_iter().filter(|text| text.contains("TUNING_TOWER")).collect();
        let [said] = said.as_slice() else { panic!("{said:?}") };
        assert!(said.starts_with("echo:line 1: TUNING_TOWER has ended, ") && said.contains(refusal), "{said}");
        assert!(printer.print.tower.is_none());
        if tower.contains("M900") {
            assert_eq!(rig.choice().pressure_advance.seconds, good);
        }
        assert_eq!(rig.believed_mm()[0], 4.0, "every line was printed");
    }
}

#[test]
fn a_halt_and_a_prepared_job_end_it() {
    let tower = "TUNING_TOWER COMMAND=M900 PARAMETER=K START=0 FACTOR=1";
    let rig = Rig::new(|_| {});
    let mut printer = printing(&rig);
    execute(&mut printer, tower).unwrap();
    printer.emergency_stop().unwrap_err();
    execute(&mut printer, "M999").unwrap();
    assert!(printer.print.tower.is_none());
    printer.interpreter.modal.in_prepared_job = true;
    let says = execute(&mut printer, tower).unwrap_err().to_string();
    assert_eq!(says, "a prepared job has its own values: TUNING_TOWER needs G-code");
}

proptest! {
    /// No words and no height cause a panic, and the value is the formula's where that is a number.
    #[test]
    fn values_of_any_words(
        start in any::<i64>(), change in any::<i64>(), size in 1..i64::MAX, skip in 0..i64::MAX,
        height_10nm in -500_000_000_i64..500_000_000, course in 0..3,
    ) {
        let [start, change, size, skip] = [start, change, size, skip].map(Decimal::from_nanos);
        let course = match course {
            0 => TowerCourse::Linear { factor: change },
            1 => TowerCourse::Bands { factor: change, band: size },
            _ => TowerCourse::Steps { delta: change, height: size },
        };
        let tower = Tower::new(&TowerWords { command: "M900", parameter: "K", start, skip, course }).unwrap();
        let value = tower.value_at(height_10nm).to_f64();
        let above = (height_10nm - skip.to_10nm_from_mm()).max(0) as f64 / 1e5;
        let size = size.to_10nm_from_mm().max(1) as f64 / 1e5;
        let by = match course {
            TowerCourse::Linear { .. } => above,
            // Halves of 10 nm are dropped.
            TowerCourse::Bands { .. } => ((above / size + 1e-9).floor() * size) + (size * 1e5 / 2.0).floor() / 1e5,
            TowerCourse::Steps { .. } => (above / size + 1e-9).floor(),
        };
        let expected = start.to_f64() + change.to_f64() * by;
        let largest = i64::MAX as f64 / 1e9;
        let expected = expected.clamp(-largest, largest);
        prop_assert!((value - expected).abs() <= 1e-6 * expected.abs().max(change.to_f64().abs()).max(1.0), "{value} {expected}");
        prop_assert!(parse(&tower.line(tower.value_at(height_10nm))).is_ok());
    }
}
