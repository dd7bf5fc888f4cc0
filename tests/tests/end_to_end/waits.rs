//! Waits, and how they end before their time.

use ferrostep_printer::Heating;

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, Machine, machine};
use crate::end_to_end::reports::temperatures;

fn now_s(machine: &Machine) -> f64 {
    machine.clock().now_ns() as f64 * 1e-9
}

/// Acts once as a serial line's interrupt does, at a given time.
fn at(when_s: f64, mut act: impl FnMut(&Machine)) -> impl FnMut(&Machine) {
    let mut done = false;
    move |machine| {
        if !done && now_s(machine) >= when_s {
            done = true;
            act(machine);
        }
    }
}

/// Sends a line and returns the replies and the time until the last.
fn timed(conversation: &mut Conversation<'_>, machine: &Machine, line: &str) -> (Vec<String>, f64) {
    let since_s = now_s(machine);
    let replies = conversation.say(line);
    (replies, now_s(machine) - since_s)
}

#[test]
fn an_emergency_stop_ends_a_wait_for_heat() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    conversation.say("M140 S60");
    let replies = conversation.say_while(b"M109 S200\n", at(5.0, Machine::halt));
    let ended_s = now_s(&machine);
    assert!((5.0..5.3).contains(&ended_s), "{ended_s} s");
    assert_eq!(replies.iter().filter(|reply| reply.starts_with("ok")).count(), 1, "{replies:?}");

    // All heaters are off, and stay off.
    let report = conversation.say("M105").concat();
    let status = machine.heating();
    for heater in ferrostep_hal_shim::Heater::ALL {
        assert_eq!((status.status(heater).target_celsius, status.status(heater).power), (0.0, 0.0), "{report}");
    }
    for line in ["G1 X5 F3000", "M104 S200", "G28", "M109 S200", "G4 P5000", "M106"] {
        let (replies, took_s) = timed(&mut conversation, &machine, line);
        assert!(replies[0].starts_with("echo:") && replies[0].contains("M999"), "{line}: {replies:?}");
        assert_eq!(replies[1], "Error:Printer halted. kill() called!", "{line}");
        assert_eq!((replies[replies.len() - 1].as_str(), took_s), ("ok", 0.0), "{line}");
    }
    assert_eq!(machine.figures().motor_steps, [0; 4]);

    assert_eq!(conversation.say("M999"), ["ok"]);
    assert_eq!(conversation.say("G1 X5 F3000"), ["ok"]);
    conversation.finish();
    assert_eq!(machine.figures().motor_steps, [400, 0, 0, 0]);
    let [nozzle, bed] = temperatures(&conversation.say("M105")[0]).try_into().unwrap();
    assert_eq!((nozzle.2, bed.2), (0.0, 0.0), "M999 switches nothing on");
}

#[test]
fn an_emergency_stop_ends_a_dwell_and_motion() {
    for line in ["G4 P60000", "M400", "G28 Z"] {
        let machine = machine(&profile("cartesian"));
        let mut conversation = Conversation::new(&machine);
        conversation.say("G1 X100 F300");
        conversation.say("G1 X0");
        let halted = std::cell::Cell::new(false);
        // The desk lets a whole move pass at a time, so this acts at the first
        // check after its time.
        let stop = at(3.0, |machine: &Machine| {
            machine.halt();
            halted.set(true);
        });
        let replies = conversation.say_while(format!("{line}\n").as_bytes(), stop);
        assert!(halted.get(), "{line}");
        assert_eq!(replies.iter().filter(|reply| reply.starts_with("ok")).count(), 1, "{line}: {replies:?}");
        assert!(now_s(&machine) < 60.0, "{line} ends at {} s", now_s(&machine));
    }
}

/// M112 in its turn: the position is the motors', and `kill() called` is said.
#[test]
fn m112_in_its_turn_halts() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    conversation.say("M104 S200");
    conversation.say("G1 X100 F600");
    let replies = conversation.say("M112");
    assert!(replies.contains(&"Error:Printer halted. kill() called!".to_owned()), "{replies:?}");
    let steps = machine.figures().motor_steps[0];
    assert!(steps < 8000, "the move was cut short");
    assert_eq!(conversation.say("M999"), ["ok"]);
    let [x, ..] = conversation.position_mm();
    assert!((x - steps as f64 / 80.0).abs() < 0.0126, "stands at {x} after {steps} steps");
    let [nozzle, _] = temperatures(&conversation.say("M105")[0]).try_into().unwrap();
    assert_eq!(nozzle.2, 0.0);
}

#[test]
fn m108_ends_a_wait_for_heat_and_not_the_heating() {
    for line in ["M109 S200", "M190 S60", "M109 R200"] {
        let machine = machine(&profile("cartesian"));
        let mut conversation = Conversation::new(&machine);
        // An M108 that comes too early is not meant for this wait.
        machine.signals().end_wait();
        let wait = format!("{line}\n");
        let replies = conversation.say_while(wait.as_bytes(), at(3.0, |machine| machine.signals().end_wait()));
        assert_eq!(replies.last().map(String::as_str), Some("ok"), "{replies:?}");
        let ended_s = now_s(&machine);
        assert!((3.0..3.3).contains(&ended_s), "{line} ends after {ended_s} s");
        let report = conversation.say("M105");
        let [nozzle, bed] = temperatures(&report[0]).try_into().unwrap();
        assert!(nozzle.2 == 200.0 || bed.2 == 60.0, "{report:?}");
    }
}

#[test]
fn a_wait_for_heat_reports_each_second_and_ends_in_the_window() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    let (replies, took_s) = timed(&mut conversation, &machine, "M109 S200");
    let (ok, lines) = replies.split_last().unwrap();
    assert_eq!(ok, "ok");
    assert!((lines.len() as f64 - took_s).abs() <= 1.5, "{} lines in {took_s} s", lines.len());
    for line in lines {
        assert!(line.starts_with(" T:") && line.contains(" /200.00 B:") && line.contains(" W:"), "{line:?}");
    }
    assert!(lines[0].ends_with(" W:?"), "{lines:?}");
    let left: Vec<u32> = lines.iter().rev().map_while(|line| line.split_once("W:")?.1.parse().ok()).collect();
    assert!(left.len() >= 9 && left.is_sorted() && left[0] <= 1 && left.iter().all(|&left| left <= 10), "{left:?}");
    let [nozzle, _] = temperatures(&conversation.say("M105")[0]).try_into().unwrap();
    assert!((nozzle.1 - 200.0).abs() <= 1.0, "{}", nozzle.1);

    // Hot already: no more than the time it must stay so.
    let (_, took_s) = timed(&mut conversation, &machine, "M109 S200");
    assert!((9.9..10.3).contains(&took_s), "{took_s} s");
    // S waits for heating only, R for cooling too.
    let (_, took_s) = timed(&mut conversation, &machine, "M109 S150");
    assert_eq!(took_s, 0.0);
    let (_, took_s) = timed(&mut conversation, &machine, "M109 R150");
    assert!(took_s > 20.0, "{took_s} s");
    let (_, took_s) = timed(&mut conversation, &machine, "M109 S0");
    assert_eq!(took_s, 0.0);

    let (_, took_s) = timed(&mut conversation, &machine, "M190 S50");
    assert!(took_s > 30.0, "{took_s} s");
    let (_, took_s) = timed(&mut conversation, &machine, "M190 S50");
    assert!((9.9..10.3).contains(&took_s), "{took_s} s");
}

#[test]
fn a_dwell_sends_reports_and_busy_messages() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    let count = |replies: &[String], start: &str| replies.iter().filter(|reply| reply.starts_with(start)).count();
    let busy = "echo:busy: processing";

    assert_eq!(conversation.say("M155 S1"), ["ok"]);
    let (replies, took_s) = timed(&mut conversation, &machine, "G4 P5000");
    assert!((5.0..5.01).contains(&took_s), "{took_s} s");
    assert!((5..=6).contains(&count(&replies, " T:")), "{replies:?}");
    assert_eq!((count(&replies, busy), count(&replies, "ok")), (2, 1), "{replies:?}");
    assert_eq!(replies.len(), count(&replies, " T:") + 3);

    conversation.say("M155 S0");
    conversation.say("M113 S1");
    let (replies, _) = timed(&mut conversation, &machine, "G4 S5");
    assert_eq!((count(&replies, busy), count(&replies, " T:")), (4, 0), "{replies:?}");
    conversation.say("M113 S0");
    let (replies, _) = timed(&mut conversation, &machine, "G4 S5");
    assert_eq!(replies, ["ok"]);
}

/// While a wait for heat prints its own lines, automatic reports would only repeat them.
#[test]
fn a_wait_for_heat_suppresses_m155_reports() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    conversation.say("M155 S1");
    let replies = conversation.say_while(b"M109 S200\n", at(20.0, |machine| machine.signals().end_wait()));
    let (waiting, plain): (Vec<_>, Vec<_>) =
        replies.iter().filter(|reply| reply.starts_with(" T:")).partition(|reply| reply.contains(" W:"));
    assert!(waiting.len() >= 18, "{replies:?}");
    assert!(plain.len() <= 1, "{plain:?}");
}

/// A host that has seen one sign of life expects the next within three seconds, motion or not.
#[test]
fn motion_sends_busy_messages() {
    for line in ["G28", "M400"] {
        let machine = machine(&profile("cartesian"));
        let mut conversation = Conversation::new(&machine);
        conversation.say("G1 X50 F600");
        let (replies, took_s) = timed(&mut conversation, &machine, line);
        assert!(took_s > 4.0, "{line} takes {took_s} s");
        assert!(replies.iter().any(|reply| reply == "echo:busy: processing"), "{line}: {replies:?}");
    }
}

/// A target below room temperature is never reached: such a wait ends by itself, with a message.
#[test]
fn a_wait_for_less_than_room_temperature_ends() {
    for (line, name) in [("M190 R20", "bed"), ("M109 R5", "nozzle"), ("M190 R21.5", "")] {
        let machine = machine(&profile("cartesian"));
        let mut conversation = Conversation::new(&machine);
        let (replies, took_s) = timed(&mut conversation, &machine, line);
        assert_eq!(replies.last().map(String::as_str), Some("ok"), "{line}: {replies:?}");
        assert!((5.0..300.0).contains(&took_s), "{line}: {took_s} s");
        let says = replies.iter().filter(|reply| reply.contains("cools no further than 22.0 C")).count();
        assert_eq!(says, usize::from(!name.is_empty()), "{line}: {replies:?}");
        assert!(replies.iter().any(|reply| reply.contains(name)), "{line}: {replies:?}");
    }
}

/// A temperature that cooling reaches is waited for.
#[test]
fn a_wait_for_cooling_lasts_until_the_target() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    conversation.say("M190 S60");
    conversation.say("M109 S200");
    for (line, index, target) in [("M109 R30", 0, 30.0), ("M190 R28", 1, 28.0)] {
        let replies = conversation.say(line);
        assert!(!replies.concat().contains("cools no further"), "{line}: {replies:?}");
        let celsius = temperatures(&conversation.say("M105")[0])[index].1;
        assert!((celsius - target).abs() <= 3.0, "{line}: {celsius}");
    }
}
