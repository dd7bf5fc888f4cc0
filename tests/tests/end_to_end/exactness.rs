//! Small jobs in which a fraction of a step, a lift or a unit is easily lost.

use ferrostep_oracle::reference::{InterpretOptions, ReferenceProfile, interpret, plan};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;

use crate::end_to_end::desk::{profile, rehearse};
use crate::end_to_end::hosts::{Conversation, machine};

/// The motors' position after some lines, and the G-code's (mm).
fn stands(machine_name: &str, lines: &str) -> ([i64; 4], [f64; 4]) {
    let machine = machine(&profile(machine_name));
    let mut conversation = Conversation::new(&machine);
    for line in lines.lines() {
        let replies = conversation.say(line);
        let refused = replies.iter().any(|reply| reply.starts_with("echo:line") && !reply.contains("soft limits"));
        assert!(!refused, "{line}: {replies:?}");
    }
    conversation.finish();
    let motor_steps = machine.desk().motor_steps();
    (motor_steps, conversation.position_mm())
}

/// Homing stops the machine and must not lose a fraction of an extruder step.
#[test]
fn homing_keeps_the_fraction_of_the_extruder() {
    // 0.9723 mm at 400 steps/mm are 388.92 steps, with any homing in between.
    let lines = "M302 P1\nG1 E-.1063\nG28 X\nG1 E.9723\n";
    assert_eq!(stands("corexy", lines).0[3], 389);
    let mut lines = "M302 P1\nM83\n".to_owned();
    for _ in 0..100 {
        // 0.475 steps each: 47.5 in the end.
        lines.push_str("G1 E.005\nG28 Z\n");
    }
    assert_eq!(stands("cartesian", &lines).0[3], 48);
}

/// G11 lowers what G10 lifted, so that Z is where it was.
#[test]
fn a_lift_is_undone_exactly() {
    let mut wrong = Vec::new();
    for (lines, z_mm) in [
        // The simple case.
        ("G1 Z5\nG10\nG1 X20\nG11\n", 5.0),
        ("G1 Z5\nG10\nG1 X20 Z6\nG11\n", 6.0),
        ("G1 Z5\nG10\nG92 Z3\nG1 Z4\nG11\nG92 Z6\n", 6.0),
        // The setting changes while lifted.
        ("G1 Z5\nG10\nM207 Z0\nG11\n", 5.0),
        ("G1 Z5\nG10\nM207 Z2\nG11\n", 5.0),
        // The soft limit leaves room for less.
        ("G1 Z199.5\nG10\nG11\nG1 Z5\n", 5.0),
        ("G1 Z199.5\nG10\nG11\n", 199.5),
        // The soft limit is met while lifted.
        ("G1 Z5\nG10\nG1 Z-3\nG11\nG1 Z5\n", 5.0),
        ("G1 Z5\nG10\nG1 Z-3\nG11\n", 0.0),
        // Homing forgets the lift.
        ("G1 Z5\nG10\nG28 Z\nG1 Z5\nG11\n", 5.0),
    ] {
        let lines = format!("G28\nM302 P1\nM207 S1 Z1\nG1 X10 F6000\n{lines}");
        let (motor_steps, position_mm) = stands("cartesian", &lines);
        let stands_mm = motor_steps[2] as f64 / 400.0;
        if (position_mm[2], stands_mm) != (z_mm, z_mm) {
            wrong.push(format!("Z is {}, the motor at {stands_mm} instead of {z_mm}: {lines:?}", position_mm[2]));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Retracted filament is pushed back to the step, without changing the G-code's E.
#[test]
fn retractions_cancel_out() {
    let lines = "G28\nM302 P1\nM207 S1.2345 Z.3\nG1 Z2 E1 F600\n";
    let (before, position_mm) = stands("cartesian", lines);
    for times in [1, 2, 25] {
        let (after, again_mm) = stands("cartesian", &format!("{lines}{}", "G10\nG10\nG11\nG11\n".repeat(times)));
        assert_eq!((after, again_mm), (before, position_mm), "{times}");
    }
}

/// Limits after G20 are in inches, like the lengths of any other command.
#[test]
fn limits_use_the_current_unit() {
    let (machine, reference) = (profile("cartesian"), ReferenceProfile::cartesian());
    let time_s = |limit: &str, moves: &str| {
        let text = format!("G28\n{limit}\nG21\nM302 P1\n{moves}\n");
        let ended = rehearse(&machine, LOOK_AHEAD_BLOCKS, &mut text.as_bytes());
        assert!(ended.outcome.is_ok(), "{text}: {:?}", ended.outcome);
        let job = interpret(text.as_bytes(), &reference, InterpretOptions::default()).unwrap();
        let planned_s = plan(&job, None).motion_time_s;
        assert!((ended.figures.motion_time_s / planned_s - 1.0).abs() < 1e-4, "{text}: planned {planned_s} s");
        ended.figures.motion_time_s
    };
    for (inches, millimetres, moves) in [
        ("G20\nM203 X2", "M203 X50.8", "G1 X100 F12000"),
        ("G20\nM201 X5", "M201 X127", "G1 X100 F12000"),
        ("G20\nM204 P5", "M204 P127", "G1 X100 E1 F6000"),
        ("G20\nM204 T5", "M204 T127", "G1 X100 F12000"),
        ("G20\nM204 R5", "M204 R127", "G1 E10 F3000"),
        ("G20\nM204 S5", "M204 S127", "G1 X100 F12000"),
        ("G20\nM205 J.01", "M205 J.254", "G1 X50 F12000\nG1 Y50\nG1 X0"),
    ] {
        assert_ne!(time_s(millimetres, moves), time_s("M107", moves), "{millimetres} changes something");
        assert_eq!(time_s(inches, moves), time_s(millimetres, moves), "{inches}");
    }
}
