//! Checks that the page calls each motion what it is: printing, travel, retraction, also where the
//! printer adds moves.

use std::process::Command;

use ferrostep_show::{Kind, Node, Recording};
use ferrostep_testkit::program::program;
use ferrostep_testkit::shown::errors;
use ferrostep_testkit::shown::prints::shown;
use serde_json::Value;

use crate::show::pages::job;

const START: &str = "M302 S0\nG28\nM83\nG1 X30 Y40 Z0.2 F6000\n";

/// The record of a text on a machine.
fn recorded(text: &str, profile: &str) -> Recording {
    let folder = job(text);
    shown(&folder.path().join("job.gcode"), profile, usize::MAX).recording
}

/// The record of a text on the machine `cartesian` with further keys.
fn recorded_with(text: &str, builtin: &str, keys: &str) -> Recording {
    let folder = job(text);
    let profile = folder.path().join("mine.toml");
    std::fs::write(&profile, ferrostep_profiles::builtin_text(builtin).unwrap().to_owned() + keys).unwrap();
    shown(&folder.path().join("job.gcode"), profile.to_str().unwrap(), usize::MAX).recording
}

fn share(recording: &Recording, kind: Kind) -> (f64, f64) {
    let share = recording.totals.kinds[kind as usize];
    (share.time_s, share.volume_mm3)
}

fn parts(recording: &Recording, kind: Kind) -> impl Iterator<Item = &Node> {
    recording.nodes.iter().filter(move |node| node.kind == kind)
}

fn assert_close(found: f64, expected: f64, part: f64) {
    assert!((found / expected - 1.0).abs() < part, "{found}, expected {expected}");
}

/// G10 and G11 are the same retraction as the one by E, and so in a prepared job.
#[test]
fn firmware_retractions_are_retractions() {
    let lines = |back: &str, on: &str| {
        let legs: String = (0..6)
            .map(|leg| format!("G1 X{} E2 F1500\n{back}\nG0 Y{} F7200\n{on}\n", 80 - leg % 2 * 40, 50 + leg))
            .collect();
        format!("{START}M207 S0.9 F2400 Z0\nM208 F2400\n{legs}G1 X40 E1 F1500\n")
    };
    let by_e = recorded(&lines("G1 E-.9 F2400", "G1 E.9 F2400"), "cartesian");
    let text = lines("G10", "G11");
    let by_g10 = recorded(&text, "cartesian");
    let folder = job(&text);
    let prepared = Command::new(program())
        .current_dir(folder.path())
        .args(["preprocess", "job.gcode", "-o", "job.gpre"])
        .output()
        .unwrap();
    assert!(prepared.status.success(), "{}", errors(&prepared));
    let prepared = shown(&folder.path().join("job.gpre"), "cartesian", usize::MAX).recording;
    for recording in [&by_g10, &prepared] {
        assert_eq!(recording.totals.retractions, 6);
        assert_close(recording.totals.longest_retraction.value, 0.9, 0.02);
        assert_close(share(recording, Kind::Print).0, share(&by_e, Kind::Print).0, 0.01);
        assert_close(share(recording, Kind::Print).1, share(&by_e, Kind::Print).1, 0.01);
        assert_close(recording.totals.greatest_flow.value, by_e.totals.greatest_flow.value, 0.02);
    }
}

/// The way to the parking place and back is no printing, in the record as in a simulation.
#[test]
fn a_change_of_filament_prints_nothing() {
    let text = |change: &str| format!("{START}G1 X90 E3 F1500\n{change}G1 X120 E1.5 F1500\n");
    let [without, with] = ["", "M600\n"].map(|change| recorded(&text(change), "cartesian"));
    assert_close(share(&with, Kind::Print).0, share(&without, Kind::Print).0, 0.03);
    assert_close(share(&with, Kind::Print).1, share(&without, Kind::Print).1, 0.01);
    assert!(with.totals.fastest_print.value < 25.6, "{:?}", with.totals.fastest_print);
    assert_eq!(parts(&with, Kind::Print).map(|node| node.layer).max(), Some(0));
    assert!(share(&with, Kind::Travel).0 > share(&without, Kind::Travel).0 + 1.0);
    let simulated = |change: &str| {
        let folder = job(&text(change));
        let output = Command::new(program())
            .current_dir(folder.path())
            .args(["simulate", "job.gcode", "--json"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", errors(&output));
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        said["contour_error_um"]["rms"].as_f64().unwrap_or_else(|| panic!("{said:#}"))
    };
    let [without_um, with_um] = ["", "M600\n"].map(simulated);
    assert!(with_um < 2.0 * without_um + 5.0, "{with_um} um, expected about {without_um} um");
}

/// Homing and probing between two lines are neither printing nor travel.
#[test]
fn homing_in_mid_print_is_homing() {
    let text = format!("{START}G1 X90 E3 F1500\nG28 X\nG1 X30 Y40 F6000\nG1 X60 E1 F1500\n");
    let recording = recorded(&text, "cartesian");
    assert!(parts(&recording, Kind::Print).all(|node| [5, 8].contains(&node.line)));
    assert!(parts(&recording, Kind::Homing).any(|node| node.line == 6));
}

/// Each tool's lines lie where its nozzle was.
#[test]
fn the_lines_of_a_second_tool_lie_where_its_nozzle_was() {
    let tools = "\n[tools]\nretract_mm = 1\nlift_mm = 0.5\n[tools.t1]\nmotor = \"e1\"\n\
                 offset_mm = { x = -18, y = 1.5, z = 0.2 }\n";
    let line = "G1 X70 Y80 Z0.6 F6000\nG1 X110 E2 F1200\n";
    let text = format!("M302 S0\nG28\nM83\n{line}T1\n{line}");
    let recording = recorded_with(&text, "cartesian", tools);
    for tool in [0, 1] {
        let line: Vec<_> = parts(&recording, Kind::Print).filter(|node| node.tool == tool).collect();
        for node in &line {
            let [x, y, z] = node.position_mm;
            assert!((69.9..110.1).contains(&x) && (y - 80.0).abs() < 0.02 && (z - 0.6).abs() < 0.01, "{node:?}");
        }
        assert!(line.last().is_some_and(|end| (end.position_mm[0] - 110.0).abs() < 0.05), "T{tool}: {line:?}");
    }
}

/// The speed on curves is the one that the plan asks for.
#[test]
fn curves_are_as_fast_as_planned() {
    for (profile, feed) in
        [("cartesian", 240), ("cartesian", 1800), ("cartesian", 5400), ("corexy", 300), ("corexy", 6000)]
    {
        let text = format!("M302 S0\nG28\nM83\nG1 X60 Y60 Z0.3 F6000\nG3 X60 Y60 I0 J25 E5 F{feed}\n");
        let recording = recorded(&text, profile);
        let expected = f64::from(feed) / 60.0;
        let fastest = recording.totals.fastest_print.value;
        assert!(fastest < 1.02 * expected, "{profile}, F{feed}: {fastest} mm/s, expected {expected}");
        let steady: Vec<f64> = parts(&recording, Kind::Print)
            .map(|node| f64::from(node.speed_mm_per_s))
            .filter(|speed| *speed > 0.5 * expected)
            .collect();
        let mean = steady.iter().sum::<f64>() / steady.len() as f64;
        assert!(mean > 0.9 * expected, "{profile}, F{feed}: {mean} mm/s, expected {expected}");
    }
}

/// The path lies above the measured bed, as the file asks for.
#[test]
fn a_tilted_bed_is_no_deviation() {
    let text = "M302 S0\nG28\nG29\nM83\nG1 X15 Y70 Z0.3 F6000\nG1 X160 E4 F1800\nG1 Z0.6\nG1 X15 E4\n";
    let recording = recorded_with(text, "prusa-mini", "\n[mesh.sheet]\ntilt_mm = { x = 0.5, y = 0.1 }\n");
    let farthest = recording.totals.greatest_deviation.value;
    assert!(farthest < 0.06, "{farthest} mm");
    for node in parts(&recording, Kind::Print) {
        let z = node.position_mm[2];
        assert!((z - 0.3).abs() < 0.05 || (z - 0.6).abs() < 0.05, "{node:?}");
    }
    assert_eq!(parts(&recording, Kind::Print).map(|node| node.layer).max(), Some(1));
}

/// A spiral without marks has a layer for each turn.
#[test]
fn a_spiral_without_marks_has_its_turns() {
    let turns = 7;
    let mut text = "M302 S0\nG28\nM83\nG1 X115 Y90 Z0.3 F6000\n".to_owned();
    for part in 1..=turns * 90 {
        let turn = f64::from(part) / 90.0;
        let (y, x) = (turn * std::f64::consts::TAU).sin_cos();
        text += &format!("G1 X{:.3} Y{:.3} Z{:.4} E.03 F1800\n", 100.0 + 15.0 * x, 90.0 + 15.0 * y, 0.3 + 0.3 * turn);
    }
    let recording = recorded(&text, "cartesian");
    assert_eq!(parts(&recording, Kind::Print).map(|node| node.layer).max(), Some(turns - 1));
}

/// A large job keeps the path of each of its layers.
#[test]
fn every_layer_of_a_large_job_is_drawn() {
    let layers = 24;
    let mut text = "M302 S0\nG28\nM83\n".to_owned();
    for layer in 0..layers {
        text += &format!(";LAYER_CHANGE\nG1 Z{:.2} F600\nG1 X130 Y100 F9000\n", 0.2 * f64::from(layer + 1));
        for part in 1..=300 {
            let (y, x) = (std::f64::consts::TAU * f64::from(part) / 300.0).sin_cos();
            let feed = 1500 + part % 5 * 90;
            text += &format!("G1 X{:.3} Y{:.3} E.02 F{feed}\n", 100.0 + 30.0 * x, 100.0 + 30.0 * y);
        }
        text += "G1 X90 Y105 F9000\n";
        for line in 0..120 {
            text += &format!(
                "G1 X{:.2} Y{} E.2 F{}\n",
                90.0 + 0.2 * f64::from(line),
                if line % 2 == 0 { 95 } else { 105 },
                2400 + line % 4 * 150
            );
        }
    }
    let folder = job(&text);
    let file = folder.path().join("job.gcode");
    let whole = shown(&file, "cartesian", usize::MAX).recording;
    let room = whole.nodes.len() / 2;
    let few = shown(&file, "cartesian", room).recording;
    assert!(few.nodes.len() <= room && few.tolerance_mm > 0.0 && few.tolerance_mm < 0.1, "{} mm", few.tolerance_mm);
    let path_mm = |recording: &Recording, layer: u32| -> (f64, usize) {
        let pairs = recording.nodes.windows(2).filter(|pair| pair[1].kind == Kind::Print && pair[1].layer == layer);
        let lengths = pairs.map(|pair| {
            let squares = (0..3).map(|axis| pair[1].position_mm[axis] - pair[0].position_mm[axis]);
            f64::from(squares.map(|side| side * side).sum::<f32>()).sqrt()
        });
        lengths.fold((0.0, 0), |(sum, count), length| (sum + length, count + 1))
    };
    let of_layers: Vec<_> = (0..layers as u32).map(|layer| (path_mm(&whole, layer).0, path_mm(&few, layer))).collect();
    for (layer, (expected, (found, _))) in of_layers.iter().enumerate() {
        assert!((found / expected - 1.0).abs() < 0.02, "layer {layer}: {found} mm, expected {expected}");
    }
    let counts = || of_layers.iter().map(|(_, (_, count))| *count);
    assert!(counts().max() < counts().min().map(|least| 2 * least), "{:?}", counts().collect::<Vec<_>>());
    let ring = few.nodes.iter().filter(|node| node.kind == Kind::Print && node.position_mm[0] > 116.0);
    for node in ring {
        let off = ((node.position_mm[0] - 100.0).hypot(node.position_mm[1] - 100.0) - 30.0).abs();
        assert!(off < 0.1, "{off} mm off the ring: {node:?}");
    }
}
