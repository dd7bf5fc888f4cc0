//! G34: several motors lift Z, and are at different heights at the start.

use super::rig::{Done, profile, run};
use ferrostep_printer::Profile;

const TWO: (&str, &str) =
    ("z = { x = -20, y = 100 }\nz2 = { x = 220, y = 100 }\n", "left = [20, 100]\nright = [170, 100]\n");
const THREE: (&str, &str) = (
    "z = { x = -20, y = 0 }\ne1 = { x = 220, y = 0 }\nz2 = { x = 100, y = 220 }\n",
    "left = [20, 20]\nright = [170, 25]\nback = [100, 180]\n",
);
const FOUR: (&str, &str) = (
    "z = { x = -20, y = -20 }\nz2 = { x = -20, y = 220 }\ne1 = { x = 220, y = 220 }\ne2 = { x = 220, y = -20 }\n",
    "a = [20, 20]\nb = [20, 180]\nc = [170, 180]\nd = [170, 20]\n",
);

fn machine((motors, points): (&str, &str), tilt_mm: [f64; 2], more: &str) -> Profile {
    let [x, y] = tilt_mm;
    let points = points.replace(" = [", " = { x = ").replace(", ", ", y = ").replace(']', " }");
    profile(&format!(
        "[mesh]\npoints = {{ x = 3, y = 3 }}\ndepth_mm = 3\n[mesh.sheet]\ntilt_mm = {{ x = {x}, y = {y} }}\n[z_motors]\n{more}\n\
         [z_motors.motors]\n{motors}[z_motors.points]\n{points}\n"
    ))
}

/// Each approach of the probe ends within this distance of the sheet.
fn with_scatter(mut machine: Profile, scatter_mm: f64) -> Profile {
    machine.mesh.as_mut().unwrap().sheet.scatter_10nm = (scatter_mm * 1e5) as i64;
    machine
}

/// Heights that G30 finds at the bed's corners afterwards, mm.
fn corners(machine: &Profile, lines: &[&str]) -> Vec<f64> {
    let probes = ["G30 X5 Y10", "G30 X175 Y10", "G30 X5 Y190", "G30 X175 Y190"];
    let done = run(machine, lines.iter().copied().chain(probes)).well();
    let found = |line: &String| line.strip_prefix("Bed X: ")?.split("Z: ").nth(1)?.parse::<f64>().ok();
    let heights: Vec<f64> = done.said.iter().filter_map(found).collect();
    heights[heights.len() - 4..].to_vec()
}

fn range(heights: &[f64]) -> f64 {
    heights.iter().copied().fold(f64::MIN, f64::max) - heights.iter().copied().fold(f64::MAX, f64::min)
}

/// Checks that Z is homed and where it should be, and that the last words say that
/// the points agree.
fn assert_aligned(done: &Done, accuracy_mm: f64) {
    let mut differ = done.said.iter().filter_map(|line| line.strip_prefix("echo:the points differ by "));
    let last: f64 = differ.next_back().unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(last <= accuracy_mm, "{:#?}", done.said);
}

#[test]
fn a_tilt_that_the_motors_can_mend_is_mended() {
    for (motors, tilt_mm) in [(TWO, [1.5, 0.0]), (THREE, [1.5, -1.0]), (FOUR, [-1.2, 1.7])] {
        let machine = machine(motors, tilt_mm, "");
        assert!(range(&corners(&machine, &["G28"])) > 1.0);
        let done = run(&machine, ["G28", "G34"]).well();
        assert_aligned(&done, 0.02);
        // The bed is level everywhere, and at the height that it had where Z was homed.
        let heights = corners(&machine, &["G28", "G34"]);
        assert!(range(&heights) < 0.03 && heights.iter().all(|height| height.abs() < 0.03), "{heights:?}");
        // A machine that is aligned already is not moved.
        let twice = run(&machine, ["G28", "G34", "G34"]).well();
        let moves = |done: &Done| done.said.iter().filter(|line| line.starts_with("echo:motor ")).count();
        assert_eq!(moves(&twice), moves(&done));
    }
}

/// Two motors cannot mend a tilt across their line, and are not moved for it.
#[test]
fn a_tilt_across_two_motors_stays() {
    let machine = machine(TWO, [1.0, 0.8], "");
    let heights = corners(&machine, &["G28", "G34"]);
    assert!((range(&heights) - 0.72).abs() < 0.05, "{heights:?}");
    assert!((heights[0] - heights[1]).abs() < 0.03 && (heights[2] - heights[3]).abs() < 0.03, "{heights:?}");
}

#[test]
fn the_mesh_keeps_its_points_and_is_not_followed() {
    let machine = machine(THREE, [1.0, -1.0], "");
    let done = run(&machine, ["G28", "G29", "G34", "M420 V"]).well();
    assert_eq!(done.said.iter().rfind(|line| line.starts_with("echo:Bed Leveling")).unwrap(), "echo:Bed Leveling OFF");
    assert!(done.said.iter().any(|line| line.starts_with("Bilinear Leveling Grid")), "{:#?}", done.said);
    // The mesh of an aligned machine is followed further.
    let done = run(&machine, ["G28", "G34", "G29", "G34", "M420"]).well();
    assert_eq!(done.said.iter().rfind(|line| line.starts_with("echo:Bed Leveling")).unwrap(), "echo:Bed Leveling ON");
}

#[test]
fn what_cannot_be_aligned_is_refused() {
    let usual = machine(THREE, [1.5, -1.0], "");
    let narrow = machine(THREE, [1.5, -1.0], "max_correction_mm = 1");
    // The probe finds another height each time.
    let scattered = with_scatter(machine(THREE, [0.0, 0.0], ""), 0.09);
    let says = |machine: &Profile, lines: &[&str]| {
        let done = run(machine, lines.iter().copied());
        done.failures.first().map(|(line, failure)| format!("{line}: {failure}")).unwrap_or_default()
    };
    for (machine, lines, expected) in [
        (&usual, &["G34"][..], "G34: X is not homed"),
        (&usual, &["G28", "M84 Z", "G34"], "G34: Z is not homed"),
        (&usual, &["G28", "G34 I31"], "G34 I31: I: 31 is out of range"),
        (&usual, &["G28", "G34 T1.1"], "G34 T1.1: T: 1.1 is out of range"),
        (&usual, &["G28", "G34 A0.4"], "G34 A0.4: A: 0.4 is out of range"),
        (&usual, &["G28", "G34 I1 A0.5"], "differ by more than T"),
        (&scattered, &["G28", "G34 I30 T0.01"], "differ by no less than before"),
        (&narrow, &["G28", "G34"], "farther apart than z_motors.max_correction_mm"),
        // The motors have moved, so that Z is not homed.
        (&usual, &["G28", "G34 I1 A0.5", "G1 Z20"], "differ by more than T"),
    ] {
        let says = says(machine, lines);
        assert!(says.contains(expected), "{lines:?}: {says}");
    }
    let failed = run(&usual, ["G28", "G34 I1 A0.5", "G34"]);
    assert!(failed.failures[1].1.to_string().contains("Z is not homed"), "{:?}", failed.failures);
    // The motors have not moved, since the points are too far apart, and Z is as before.
    let refused = run(&narrow, ["G28", "G34", "G1 Z20"]);
    assert_eq!(refused.failures.len(), 1, "{:?}", refused.failures);
    // After a failure the axis homes over its whole length, and the rest is done.
    let again = run(&usual, ["G28", "G34 I1 A0.5", "G28 Z", "G34"]);
    assert_eq!(again.failures.len(), 1, "{:?}", again.failures);
    assert_aligned(&again, 0.02);
}

#[test]
fn klippers_names_and_a_machine_without_motors_to_align() {
    let machine = machine(FOUR, [1.0, 0.5], "");
    let done = run(&machine, ["G28", "QUAD_GANTRY_LEVEL RETRIES=3 RETRY_TOLERANCE=0.05"]).well();
    assert_aligned(&done, 0.05);
    let one = profile("");
    let done = run(&one, ["G28", "G34", "Z_TILT_ADJUST"]).well();
    assert!(done.said.iter().any(|line| line.contains("the profile has no z_motors with points; no effect")));
}
