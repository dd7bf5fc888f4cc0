//! The M425 command.

use ferrostep_planner::Kinematics;
use ferrostep_planner::backlash::Backlash;

use crate::motion::homing::tests::rig::{Rig, RigPrinter, execute};

const BACKLASH: Backlash = Backlash { play_mm: [0.1, 0.0, 0.02], correction: 1.0, smoothing_mm: 3.0 };

fn rig(kinematics: Kinematics) -> Rig {
    Rig::new(move |profile| {
        profile.kinematics = kinematics;
        profile.backlash = Some(BACKLASH);
    })
}

fn play(printer: &RigPrinter<'_>) -> Backlash {
    use crate::ports::Motion;
    printer.motion.backlash()
}

/// Returns the reason why a line is refused.
fn refusal(printer: &mut RigPrinter<'_>, line: &str) -> String {
    execute(printer, line).unwrap_err().to_string()
}

#[test]
fn words_change_what_they_name() {
    let rig = rig(Kinematics::Cartesian);
    let mut printer = rig.printer();
    execute(&mut printer, "M425 Y0.08 F0.5").unwrap();
    assert_eq!(play(&printer), Backlash { play_mm: [0.1, 0.08, 0.02], correction: 0.5, ..BACKLASH });
    // Lengths are in inches wherever others are.
    execute(&mut printer, "G20").unwrap();
    execute(&mut printer, "M425 X0.01 S0.2").unwrap();
    let Backlash { play_mm: [x, ..], smoothing_mm, .. } = play(&printer);
    assert_eq!((x, smoothing_mm), (0.254, 5.08));
    rig.last_texts();
    execute(&mut printer, "M425").unwrap();
    assert_eq!(rig.last_texts(), ["echo:  M425 F0.50 S5.08 X0.254 Y0.08 Z0.02 ; (mm)"]);
}

#[test]
fn numbers_out_of_range_change_nothing() {
    let rig = rig(Kinematics::Cartesian);
    let mut printer = rig.printer();
    for (line, expected) in [
        ("M425 Y0.08 X2.5", "X: 2.5 is out of range, expected 0 to 2"),
        ("M425 Y0.08 Z-0.1", "Z: -0.1 is out of range, expected 0 to 2"),
        ("M425 Y0.08 F1.1", "F: 1.1 is out of range, expected 0 to 1"),
        ("M425 Y0.08 S101", "S: 101 is out of range, expected 0 to 100"),
    ] {
        let text = refusal(&mut printer, line);
        assert!(text.starts_with(expected), "{line}: {text}");
        assert_eq!(play(&printer), BACKLASH, "{line}");
    }
}

#[test]
fn motors_that_move_two_axes_have_no_play_of_one() {
    let rig = rig(Kinematics::CoreXy);
    let mut printer = rig.printer();
    // The profile's own value, which its reader would have refused.
    assert!(refusal(&mut printer, "M425 Z0.03").starts_with("X: its motors also move another axis"));
    execute(&mut printer, "M425 X0 Z0.03").unwrap();
    assert_eq!(play(&printer).play_mm, [0.0, 0.0, 0.03]);
    assert!(refusal(&mut printer, "M425 Y0.1").starts_with("Y: its motors also move another axis"));
}

#[test]
fn without_the_table_it_has_no_effect_and_says_so() {
    let rig = Rig::new(|_| {});
    let mut printer = rig.printer();
    for line in ["M425 X0.1", "M425 Z", "M425 Z F0", "M425"] {
        execute(&mut printer, line).unwrap();
        let command = ferrostep_gcode::parse(line).unwrap();
        let mut remarks = ferrostep_gcode::Remarks::NONE;
        printer.add_remarks(&command, &mut remarks);
        assert_eq!(remarks.to_string(), "the profile has no backlash; no effect");
    }
    assert_eq!(play(&printer), Backlash::NONE);
}
