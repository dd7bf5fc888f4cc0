//! Refusals of commands for the mesh, and the state after a failure.

use super::rig::{profile, run};

/// The texts of the refusals, and all replies.
fn refusals(mesh: &str, lines: &[&str]) -> (Vec<String>, Vec<String>) {
    let done = run(&profile(mesh), lines.iter().copied());
    (done.failures.iter().map(|(_, failure)| failure.to_string()).collect(), done.said)
}

/// Each refusal names the wrong word.
#[test]
fn places_off_the_bed() {
    for (line, says) in [
        ("G30 X201", "X: 201 is out of range, expected 0 to 200"),
        ("G30 X10 Y-1", "Y: -1 is out of range, expected 0 to 200"),
        ("M48 X-30", "X: -30 is out of range, expected 0 to 200"),
        ("M48 P3", "P: 3 is out of range, expected 4 to 255"),
        ("G29 L-5 R100 F10 B100", "L: -5 is out of range, expected 0 to 199"),
        ("G29 L10 R210 F10 B100", "R: 210 is out of range, expected 11 to 200"),
        ("G29 L50 R20 F10 B100", "R: 20 is out of range, expected 51 to 200"),
        ("G29 L5 R100 F10 B201", "B: 201 is out of range, expected 11 to 200"),
        ("G29 X10 Y10 W300 H20", "W: 300 is out of range, expected 1 to 190"),
        ("M555 X10 Y195 W30 H20", "H: 20 is out of range, expected 1 to 5"),
        ("M420 Z-1", "Z: -1 is out of range, expected 0 or more"),
        ("M420 Z201", "Z: 201 is out of range, expected 0 to 200"),
        ("M421 I0 J0 Z0", "the bed has no mesh: measure one with G29"),
    ] {
        let (failures, _) = refusals("", &["G28", line]);
        assert_eq!(failures.len(), 1, "{line}: {failures:?}");
        assert!(failures[0].starts_with(says), "{line}: {failures:?}");
    }
    let (failures, _) = refusals(
        "[mesh]\npoints = { x = 3, y = 2 }\n",
        &["G28", "G29", "M421 I3 J0 Z0", "M421 I0 J2 Z0", "M421 I0 J0 Z11"],
    );
    assert_eq!(
        failures,
        [
            "I: 3 is out of range, expected 0 to 2",
            "J: 2 is out of range, expected 0 to 1",
            "Z: 11 is out of range, expected -10 to 10"
        ]
    );
}

#[test]
fn a_machine_that_is_not_homed() {
    for line in ["G29", "G30", "M48", "M420 S1", "BED_MESH_CALIBRATE"] {
        let (failures, _) = refusals("", &[line]);
        assert_eq!(failures, ["X is not homed: send G28 before probing or mesh levelling"], "{line}");
        let (failures, _) = refusals("", &["G28", "M84 Y", line]);
        assert_eq!(failures, ["Y is not homed: send G28 before probing or mesh levelling"], "{line}");
    }
}

/// The job continues, as in Marlin, and the host reads the reason.
#[test]
fn a_mesh_that_is_missing_is_told() {
    for lines in [&["G28", "M420 S1"][..], &["G28", "G29", "BED_MESH_CLEAR", "M420 S1"], &["G28", "G29 A"]] {
        let (failures, said) = refusals("", lines);
        assert_eq!(failures, [""; 0]);
        let told = "echo:Failed to enable Bed Leveling: the bed has no mesh: measure one with G29";
        assert!(said.iter().any(|line| line == told), "{lines:?}: {said:?}");
        assert_eq!(said.iter().rev().find(|line| line.starts_with("echo:Bed")).unwrap(), "echo:Bed Leveling OFF");
    }
}

/// Probes that do not trigger, are triggered at once, or scatter: each is reported by name and
/// place, and leaves no mesh.
#[test]
fn a_probe_that_fails() {
    for (sheet, says, place) in [
        // Lower at the left than the nozzle may go.
        ("tilt_mm = { x = 4, y = 0 }", "its sensor did not trigger", "X0.00 Y0.00"),
        // Higher there than the nozzle is lifted.
        ("tilt_mm = { x = -5, y = -5 }\nbend_mm = -5", "its sensor is triggered away from the end", "X0.00 Y0.00"),
        ("scatter_mm = 0.6", "the second approach met the sensor", ""),
    ] {
        let mesh = format!("[mesh]\nlift_mm = 3\n[mesh.sheet]\n{sheet}\n");
        let lines = ["G28", "M140 S50", "G29", "M420 S1", "M105"];
        // A probe that scatters may fail to home already.
        let done = run(&profile(&mesh), lines);
        let failed = done.failures.iter().find(|(line, _)| line == "G29" || line == "G28");
        let (line, failure) = failed.unwrap_or_else(|| panic!("{sheet}: nothing failed: {:?}", done.said));
        assert!(failure.to_string().contains(says), "{sheet}: {failure}");
        if line == "G29" {
            assert!(
                done.said.iter().any(|said| said.contains(&format!("the probe failed at {place}"))),
                "{:?}",
                done.said
            );
            assert!(done.said.iter().any(|said| said.contains("the bed has no mesh")), "{:?}", done.said);
            // The nozzle does not stay at the bed, and the heater has its target.
            assert!(done.logical_mm[2] >= 2.9, "{sheet}: {:?}", done.logical_mm);
        }
        assert!(done.said.iter().all(|said| !said.contains("Leveling ON")), "{:?}", done.said);
    }
}

/// A move that Z cannot follow is refused and changes nothing.
#[test]
fn a_mesh_that_z_cannot_follow() {
    let mesh = "[mesh]\npoints = { x = 3, y = 3 }\nfade_mm = 0\n";
    let lines = ["G28", "G29", "M421 I1 J1 Z6", "M420 V", "G1 X100 Y100 Z1 F6000"];
    let done = run(&profile(mesh), lines);
    let [(line, failure)] = &done.failures[..] else { panic!("{:?}", done.failures) };
    assert_eq!(line, "M421 I1 J1 Z6");
    assert!(
        failure.to_string().starts_with("the mesh rises by 6.0 % between two points, expected at most 5.0 %"),
        "{failure}"
    );
    assert!((done.place_mm()[2] - 1.0).abs() < 0.006, "{:?}", done.place_mm());
    let done = run(&profile(mesh), ["G28", "G29", "M421 I1 J1 Z0.5", "M420 Z1", "M420"]);
    assert_eq!(
        done.failures[0].1.to_string(),
        "Z: the mesh is too uneven to fade out by then, expected 0 or at least 2.00 mm"
    );
    assert!(
        done.said.ends_with(&["echo:Bed Leveling ON".to_owned(), "echo:Fade Height OFF".to_owned()]),
        "{:?}",
        done.said
    );
}
