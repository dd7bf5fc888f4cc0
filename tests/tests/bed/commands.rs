//! The commands of the bed, and the state that they leave unchanged.

use super::rig::{PROBE_MM, profile, run, sheet_mm};

const TILTED: &str = "[mesh]\nfade_mm = 0\n[mesh.sheet]\ntilt_mm = { x = 0.8, y = 0.4 }\n";

fn near(one: f64, other: f64) -> bool {
    (one - other).abs() < 0.006
}

/// The heights that G29 reports are the sheet's, less that at home.
#[test]
fn g29_reports_the_sheet() {
    let machine =
        profile("[mesh]\npoints = { x = 3, y = 2 }\n[mesh.sheet]\ntilt_mm = { x = 0.8, y = 0.4 }\nbend_mm = 0.3\n");
    let done = run(&machine, ["G28", "G29"]).well();
    let home = sheet_mm(&machine, [100.0, 100.0]);
    let rows: Vec<Vec<f64>> = done
        .said
        .iter()
        .filter(|line| line.contains(" +") || line.contains(" -"))
        .map(|line| line.split_whitespace().skip(1).map(|number| number.parse().unwrap()).collect())
        .collect();
    assert_eq!(rows.iter().map(Vec::len).collect::<Vec<_>>(), [3, 3], "{:#?}", done.said);
    for (y, row) in [0.0, 200.0].into_iter().zip(&rows) {
        for (x, height) in [0.0, 100.0, 200.0].into_iter().zip(row) {
            let expected = sheet_mm(&machine, [x, y]) - home;
            assert!(near(*height, expected), "{height} at {x} {y}, expected {expected}");
        }
    }
    assert_eq!(done.line("echo:Bed Leveling "), "ON");
    assert_eq!(done.line("echo:Fade Height "), "10.00");
}

/// M420 in mid-print does not move anything: the coordinates change, and the next line goes to its
/// height above the sheet.
#[test]
fn switching_does_not_jump() {
    let machine = profile(TILTED);
    let start = ["G28", "G29", "G1 X180 Y150 Z1 F6000", "M400"];
    let at = |more: &[&str]| run(&machine, start.iter().chain(more).copied()).well();
    let on = at(&[]);
    let sheet = sheet_mm(&machine, [180.0, 150.0]);
    assert!(near(on.place_mm()[2] - sheet, 1.0), "{:?}", on.place_mm());
    for (lines, logical) in [
        (&["M420 S0"][..], 1.0 + sheet - sheet_mm(&machine, [100.0, 100.0])),
        (&["M420 S0", "M420 S1"], 1.0),
        (&["M420 S0", "M420 S1", "M420 S1", "M420 V", "M114"], 1.0),
        (&["M421 I0 J0 Q0"], 1.0),
        (&["M410"], 1.0),
    ] {
        let done = at(lines);
        assert_eq!(done.steps.len(), on.steps.len(), "{lines:?} moved something");
        assert!(near(done.logical_mm[2], logical), "{lines:?}: {:?}, expected {logical}", done.logical_mm);
    }
    let off = at(&["M420 S0", "G1 Z1"]);
    assert!(near(off.place_mm()[2], 1.0 + sheet_mm(&machine, [100.0, 100.0])), "{:?}", off.place_mm());
    let again = at(&["M420 S0", "G1 Z1", "M420 S1", "G1 Z1"]);
    assert!(near(again.place_mm()[2] - sheet, 1.0), "{:?}", again.place_mm());
}

/// Commands other than moves keep the nozzle's height above the sheet: lines, the height and Z as
/// it is reported, mm.
#[test]
fn other_commands_keep_the_height_above_the_sheet() {
    let machine = profile(TILTED);
    for (lines, gap, logical) in [
        // The coordinates' zero is another one.
        (&["G1 Z1", "G92 Z0", "G1 X20 Y180"][..], 1.0, 0.0),
        (&["G1 Z1", "M290 Z-0.2 P0", "G1 X20 Y180"], 0.8, 1.0),
        // A print pauses and continues: the nozzle is back above the sheet.
        (&["G1 Z1", "G91", "G1 X-20", "G1 X20", "G90"], 1.0, 1.0),
        (&["G1 Z1", "M18 E", "M400", "G1 X30"], 1.0, 1.0),
        // In relative coordinates.
        (&["G1 Z1", "G91", "G1 Z0.5 X3", "G1 Z-0.2"], 1.3, 1.3),
        // An arc.
        (&["G1 Z1", "G2 X60 Y60 I-20 J-20"], 1.0, 1.0),
        // A mesh that is measured again, of a part.
        (&["G29 L20 R120 F20 B120", "G1 X100 Y100 Z1"], 1.0, 1.0),
        (&["G29 X20 Y20 W60 H80", "G1 X60 Y60 Z1"], 1.0, 1.0),
        (&["M555 X20 Y20 W60 H80", "G29 P1", "G1 X60 Y60 Z1"], 1.0, 1.0),
        (&["BED_MESH_CALIBRATE MESH_MIN=20,20 MESH_MAX=90,90", "G1 X60 Y60 Z1"], 1.0, 1.0),
        (&["G1 Z1", "G29 O", "M400"], 1.0, 1.0),
        // The mesh is followed again after a probing command.
        (&["G30 X50 Y50", "G1 X160 Y160 Z1"], 1.0, 1.0),
        (&["M48 P4", "G1 X160 Y160 Z1"], 1.0, 1.0),
        // Homing forgets that Z followed, not the mesh.
        (&["G28", "M420 S1", "G1 X160 Y160 Z1"], 1.0, 1.0),
        (&["G28 X", "M420 S1", "G1 X160 Y160 Z1"], 1.0, 1.0),
    ] {
        let all = ["G28", "G29", "G1 X100 Y100 Z3 F6000"].iter().chain(lines).copied();
        let done = run(&machine, all).well();
        let [x, y, z] = done.place_mm();
        assert!(
            near(z - sheet_mm(&machine, [x, y]), gap),
            "{lines:?}: {:?} over {}",
            [x, y, z],
            sheet_mm(&machine, [x, y])
        );
        assert!(near(done.logical_mm[2], logical), "{lines:?}: {:?}", done.logical_mm);
    }
}

/// G28 switches bed following off, as in Marlin.
#[test]
fn homing_switches_off_and_keeps_the_mesh() {
    let machine = profile(TILTED);
    let home = sheet_mm(&machine, [100.0, 100.0]);
    for homing in ["G28", "G28 Z", "G28 X", "G28 Y"] {
        let done = run(&machine, ["G28", "G29", homing, "G1 X180 Y180 Z2 F6000", "M420"]).well();
        let last = done.said.iter().rev().find(|line| line.starts_with("echo:Bed Leveling")).unwrap();
        assert_eq!(last, "echo:Bed Leveling OFF", "{homing}");
        assert!(near(done.place_mm()[2], 2.0 + home), "{homing}: {:?}", done.place_mm());
    }
}

/// The correction fades with the height, and is gone above it.
#[test]
fn the_correction_fades() {
    let machine = profile(&TILTED.replace("fade_mm = 0", "fade_mm = 10"));
    let (home, sheet) = (sheet_mm(&machine, [100.0, 100.0]), sheet_mm(&machine, [180.0, 180.0]));
    for (z, left) in [(0.2, 0.98), (5.0, 0.5), (8.0, 0.2), (10.0, 0.0), (50.0, 0.0)] {
        let line = format!("G1 X180 Y180 Z{z} F6000");
        for way in
            [&["G28", "G29", line.as_str()][..], &["G28", "G29", "G1 X180 Y180 Z1 F6000", "G1 Z30", line.as_str()]]
        {
            let done = run(&machine, way.iter().copied()).well();
            let expected = z + home + (sheet - home) * left;
            assert!(near(done.place_mm()[2], expected), "{way:?}: {:?}, expected {expected}", done.place_mm());
        }
    }
    // M420 Z changes it, without a move.
    let steps =
        |more: &[&str]| run(&machine, ["G28", "G29", "G1 X180 Y180 Z5 F6000"].iter().chain(more).copied()).well();
    assert_eq!(steps(&["M420 Z20"]).steps.len(), steps(&[]).steps.len());
    let done = steps(&["M420 Z20", "G1 Z5"]);
    assert!(near(done.place_mm()[2], 5.0 + home + (sheet - home) * 0.75), "{:?}", done.place_mm());
}

/// G30 reports the place of the probe and the sheet's height there; the probe's
/// offset is in neither.
#[test]
fn g30_reports_one_place() {
    let machine = profile(TILTED);
    let home = sheet_mm(&machine, [100.0, 100.0]);
    let done = run(&machine, ["G28", "G30 X180 Y30"]).well();
    let words: Vec<f64> = done.line("Bed X: ").split([' ', ':']).filter_map(|word| word.parse().ok()).collect();
    let [x, y, z] = words[..] else { panic!("{words:?}") };
    assert_eq!([x, y], [180.0, 30.0]);
    assert!(near(z, sheet_mm(&machine, [180.0, 30.0]) - home), "{z}");
    let [nozzle_x, nozzle_y, _] = done.place_mm();
    assert!(near(nozzle_x + PROBE_MM[0], 180.0) && near(nozzle_y + PROBE_MM[1], 30.0), "{:?}", done.place_mm());
    // A place without words is the present one: home.
    assert!(near(run(&machine, ["G28", "G30"]).well().line("Bed X: 100.00 Y: 100.00 Z: ").parse().unwrap(), 0.0));
}

/// Another M851 moves home, and the heights of the mesh with it: the nozzle's height above
/// the sheet stays.
#[test]
fn the_sum_of_mesh_and_probe_offset_is_right() {
    let machine = profile(TILTED);
    // The nozzle is said to be 0.3 mm higher when the probe triggers: it goes lower by that.
    for (lines, gap) in [
        (&["M851 Z-1.5", "G28", "G29", "G1 X30 Y180 Z1 F6000"][..], 0.7),
        (&["G28", "G29", "M851 Z-1.5", "G28", "M420 S1", "G1 X30 Y180 Z1 F6000"], 0.7),
        // M851 has no effect yet: Z was homed before.
        (&["G28", "M851 Z-1.5", "G29", "G1 X30 Y180 Z1 F6000"], 1.0),
    ] {
        let done = run(&machine, lines.iter().copied()).well();
        let [x, y, z] = done.place_mm();
        assert!(near(z - sheet_mm(&machine, [x, y]), gap), "{lines:?}: {}", z - sheet_mm(&machine, [x, y]));
    }
}

/// M421 sets a point and adds to it.
#[test]
fn m421_sets_a_point() {
    let machine = profile("[mesh]\npoints = { x = 3, y = 3 }\nfade_mm = 0\n");
    for (line, height) in [("M421 I1 J1 Z0.2", 0.2), ("M421 I1 J1 Q-0.15", -0.15)] {
        let done = run(&machine, ["G28", "G29", line, "G1 X100 Y100 Z1 F6000"]).well();
        assert!(near(done.place_mm()[2], 1.0 + height), "{line}: {:?}", done.place_mm());
    }
}

/// A stop in mid-move leaves the correction where the motors are: Z's coordinate is that of the
/// plan, and the next line continues at its height above the sheet.
#[test]
fn a_stop_in_mid_move_keeps_the_height() {
    let machine = profile(TILTED);
    // More moves than the look-ahead ring holds: when the last of them is taken, the
    // machine is among them.
    let moves: Vec<String> =
        (0..400).map(|index| format!("G1 X{} Y{} F9000", index / 2, if index % 2 == 0 { 10 } else { 190 })).collect();
    let mut lines = vec!["G28", "G29", "G1 X0 Y0 Z1 F6000"];
    lines.extend(moves.iter().map(String::as_str));
    lines.push("M410");
    let stopped = run(&machine, lines.iter().copied());
    let [x, y, z] = stopped.place_mm();
    assert!(x > 20.0 && x < 199.0, "{x}");
    assert!(near(stopped.logical_mm[0], x) && near(stopped.logical_mm[1], y), "{:?}", stopped.logical_mm);
    assert!((stopped.logical_mm[2] - 1.0).abs() < 0.005, "{:?}", stopped.logical_mm);
    assert!(near(z - sheet_mm(&machine, [x, y]), 1.0), "{z} over {}", sheet_mm(&machine, [x, y]));
    lines.extend(["G1 X190 Y20 Z1"]);
    let done = run(&machine, lines);
    let [x, y, z] = done.place_mm();
    assert!(near(z - sheet_mm(&machine, [x, y]), 1.0), "{z} over {}", sheet_mm(&machine, [x, y]));
}

/// A travel that follows a high surface up to the machine's top ends lower by the surface's height.
#[test]
fn z_stays_below_its_upper_end() {
    let machine = profile(TILTED);
    let top = machine.size_10nm[2] as f64 / 1e5;
    let lines = ["G28", "G29", "G1 X200 Y200 Z5 F6000", "G1 Z300"];
    let done = run(&machine, lines).well();
    let said = done.line("echo:line 4: outside the soft limits, Z ends at ");
    let ends: f64 = said.split(' ').next().unwrap().parse().unwrap();
    let above_home = sheet_mm(&machine, [200.0, 200.0]) - sheet_mm(&machine, [100.0, 100.0]);
    assert!(ends < top - above_home, "{said}");
    assert!(done.place_mm()[2] - sheet_mm(&machine, [100.0, 100.0]) <= top, "{:?}", done.place_mm());
}

/// A machine whose axes are skew: the mesh is measured and followed along its axes, also after the
/// skew was set later. G30 goes to a place of the G-code and reports that.
#[test]
fn a_skew_machine_follows_its_bed() {
    let skew = "[skew]\nxy.factor = 0.05\nyz.factor = -0.02\n";
    for (keys, lines) in [
        (format!("{TILTED}{skew}"), &["G28", "G29"][..]),
        (TILTED.to_owned(), &["G28", "G29", "M852 I0.05 K-0.02"]),
        (
            format!("{TILTED}{skew}"),
            &["G28", "G29", "M852 I0 K0", "G1 X50 Y50 Z3 F6000", "SET_SKEW CLEAR=1", "M852 I.05 K-.02"],
        ),
    ] {
        let machine = profile(&keys);
        let moves = ["G1 X30 Y180 Z1 F6000", "G1 X160 Y20"];
        for count in 1..=moves.len() {
            let done = run(&machine, lines.iter().copied().chain(moves.into_iter().take(count))).well();
            let [x, y, z] = done.place_mm();
            assert!(near(z - sheet_mm(&machine, [x, y]), 1.0), "{lines:?}: {}", z - sheet_mm(&machine, [x, y]));
            let [asked_x, asked_y, asked_z, _] = done.logical_mm;
            assert_eq!([asked_x, asked_y, asked_z], [[30.0, 180.0, 1.0], [160.0, 20.0, 1.0]][count - 1]);
            // The plan's height, above which the mesh lifts Z, has no part in it.
            let lean = 0.05 * (asked_y + 0.02 * asked_z);
            assert!((x - (asked_x - lean)).abs() < 0.02 && (y - (asked_y + 0.02)).abs() < 0.01, "{x} {y}");
        }
    }
    let machine = profile(&format!("{TILTED}{skew}"));
    let done = run(&machine, ["G28", "G30 X150 Y40"]).well();
    let home = sheet_mm(&machine, [100.0, 100.0]);
    let height: f64 = done.line("Bed X: 150.00 Y: 40.00 Z: ").parse().unwrap();
    assert!(near(height, sheet_mm(&machine, [150.0 - 0.05 * 40.0, 40.0]) - home), "{height}");
}

/// G30 answers in the coordinates in which it was asked.
#[test]
fn g30_answers_in_the_jobs_coordinates() {
    let done = run(&profile(TILTED), ["G28", "G92 X0 Y0", "G30 X-50 Y20"]).well();
    assert!(done.line("Bed X: ").starts_with("-50.00 Y: 20.00"), "{:#?}", done.said);
}
