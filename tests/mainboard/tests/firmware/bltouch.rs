//! A BLTouch at the Octopus's connector for one: homing, a mesh and lines that follow it, each of
//! its faults, and every end of a program.

use ferrostep_mainboard::parts::bltouch::{Fault, Record};

use crate::firmware::bench::Bench;
use crate::firmware::board_pins::force_panic;
use crate::firmware::equipped::{self, equipped};

fn boot() -> Bench {
    let mut bench = equipped::boot();
    // The pulses of the start.
    bench.pass(1_000);
    bench
}

/// Record of the probe, and two flags: its pin is out; it flashes.
fn probe(bench: &mut Bench) -> (Record, bool, bool) {
    bench.with(|machine, _| {
        let probe = machine.plant.bltouch.as_ref().unwrap();
        (probe.record(), probe.is_out(), probe.is_in_alarm())
    })
}

fn is_out(bench: &mut Bench) -> bool {
    probe(bench).1
}

/// Height of the nozzle above the bed, mm, which it must never have been pressed into.
fn height_mm(bench: &mut Bench) -> f64 {
    bench.with(|machine, _| {
        assert_eq!(machine.plant.motion.sheet().crash(), None);
        machine.plant.motion.position_mm(2)
    })
}

fn break_it(bench: &mut Bench, fault: Option<Fault>) {
    bench.change(move |plant, _| plant.bltouch.as_mut().unwrap().set_fault(fault));
}

/// Sends a line that is refused; what it says.
fn refused(bench: &mut Bench, line: &str) -> String {
    bench.host.send_raw(format!("{line}\n").as_bytes()).unwrap();
    let is_refusal = |text: &str| ["pin does not", "touch mode"].iter().any(|part| text.contains(part));
    let says = bench.host.wait_for("a refusal", is_refusal).unwrap();
    bench.host.wait_for("its ok", |text| text == "ok").unwrap();
    says
}

/// Nanoseconds by which pulses may be too long or too short: an edge waits for the step interrupt.
const WIDTH_NS: u64 = 3_000;

#[test]
fn it_homes_measures_the_bed_and_lines_follow_it() {
    let mut bench = boot();
    assert_eq!(probe(&mut bench).0.commands, 1, "called in at the start");
    bench.host.send("G28").unwrap();
    assert!((height_mm(&mut bench) - 10.0).abs() < 0.02);
    let (homed, is_out, alarm) = probe(&mut bench);
    assert_eq!((homed.touches, is_out, alarm), (2, false, false));
    bench.host.send("G29").unwrap();
    let (measured, is_out, alarm) = probe(&mut bench);
    assert_eq!((measured.touches, is_out, alarm), (2 + 2 * 9, false, false));
    // Touch mode, out and in: for each of the two touches of a place.
    assert_eq!(measured.commands - homed.commands, 3 * 9 * 2);
    for line in ["G1 Z0.3 F600", "G1 X100 Y100 F6000", "G1 X200 Y120", "M400"] {
        bench.host.send(line).unwrap();
        assert!(height_mm(&mut bench) > 0.2);
    }
    assert!((height_mm(&mut bench) - 0.3).abs() < 0.02);
    bench.host.send("G1 Z20 F600").unwrap();
    bench.host.send("G30 X120 Y90").unwrap();
    let (end, is_out, alarm) = probe(&mut bench);
    assert_eq!((end.touches, is_out, alarm), (measured.touches + 2, false, false));
    assert_eq!((end.steps_with_pin_out, end.strange_pulses, end.alarms), (0, 0, 0));
    assert!(end.worst_width_ns < WIDTH_NS, "{} ns", end.worst_width_ns);
    println!("{} pulses, at most {} ns beside their width", end.pulses, end.worst_width_ns);
}

#[test]
fn each_fault_ends_homing_and_probing_before_z_goes_down() {
    for (fault, says) in [
        (Fault::StuckOut, "pin does not go in"),
        (Fault::StuckIn, "pin does not go out"),
        (Fault::SignalWire, "pin does not go in"),
        (Fault::ServoWire, "does not trigger in touch mode"),
    ] {
        // Broken from the start, the pin where it sticks.
        let mut bench = boot();
        if fault == Fault::StuckOut {
            bench.change(|plant, _| plant.bltouch.as_mut().unwrap().pull_out());
        }
        break_it(&mut bench, Some(fault));
        let before_mm = height_mm(&mut bench);
        let refusal = refused(&mut bench, "G28");
        assert!(refusal.contains(says), "{fault:?}: {refusal}");
        assert!(height_mm(&mut bench) >= before_mm, "{fault:?}");
        assert_eq!(probe(&mut bench).0.steps_with_pin_out, 0, "{fault:?}");
        // Mended, it homes; broken anew, it measures nothing, and the nozzle stays up.
        break_it(&mut bench, None);
        bench.host.send("G28").unwrap();
        if fault == Fault::StuckOut {
            bench.host.send("M401").unwrap();
        }
        break_it(&mut bench, Some(fault));
        let before_mm = height_mm(&mut bench);
        let refusal = refused(&mut bench, "G30");
        assert!(refusal.contains(says), "{fault:?}: {refusal}");
        assert!(height_mm(&mut bench) >= before_mm - 0.01, "{fault:?}");
        assert_eq!(probe(&mut bench).0.steps_with_pin_out, 0, "{fault:?}");
    }
}

/// A pin in alarm, as after a push by hand, is released once, and homing continues.
#[test]
fn an_alarm_is_released_once() {
    let mut bench = boot();
    break_it(&mut bench, Some(Fault::StuckIn));
    bench.host.send("BLTOUCH_DEBUG COMMAND=pin_down").unwrap();
    assert!(probe(&mut bench).2);
    break_it(&mut bench, None);
    bench.host.send("G28").unwrap();
    let (record, is_out, alarm) = probe(&mut bench);
    assert_eq!((record.alarms, is_out, alarm), (1, false, false));
    assert!((height_mm(&mut bench) - 10.0).abs() < 0.02);
}

#[test]
fn commands_move_the_pin() {
    let mut bench = boot();
    for (line, is_out_after) in [
        ("M401", true),
        ("M401", true),
        ("M402", false),
        ("M280 P0 S10", true),
        ("M280 P0 S90", false),
        ("BLTOUCH_DEBUG COMMAND=pin_down", true),
        ("BLTOUCH_DEBUG COMMAND=reset", false),
        ("M280 P0 S650", true),
        ("BLTOUCH_DEBUG COMMAND=pin_up", false),
        ("M401", true),
        // Before X moves.
        ("G28 X", false),
    ] {
        bench.host.send(line).unwrap();
        assert_eq!(is_out(&mut bench), is_out_after, "{line}");
    }
    let before = probe(&mut bench).0;
    bench.host.send("M280 P0").unwrap();
    let wrong = ["M280 P0 S200", "M280 P0 S3000", "BLTOUCH_DEBUG COMMAND=up"];
    for line in wrong {
        bench.host.send_raw(format!("{line}\n").as_bytes()).unwrap();
        bench.host.wait_for("a refusal", |text| text.starts_with("echo:line")).unwrap();
        bench.host.wait_for("its ok", |text| text == "ok").unwrap();
    }
    bench.pass(500);
    let after = probe(&mut bench).0;
    assert_eq!(after, before, "no pulse");
    assert_eq!((after.steps_with_pin_out, after.alarms), (0, 0));
}

/// M410 and M112 while the nozzle goes down, M112 at rest, a panic and a reset: the pin goes in.
#[test]
fn no_end_leaves_the_pin_out() {
    let mut bench = boot();
    bench.host.send("G28").unwrap();
    for stop in ["M410", "M112"] {
        bench.host.send("G1 Z60 F900").unwrap();
        bench.host.send("M400").unwrap();
        bench.host.send_raw(b"G28 Z\n").unwrap();
        let mut looks = 0;
        while !(is_out(&mut bench) && height_mm(&mut bench) < 55.0) {
            bench.wait_us(20_000);
            looks += 1;
            assert!(looks < 1_000);
        }
        bench.host.send_raw(format!("{stop}\n").as_bytes()).unwrap();
        bench.pass(1_000);
        assert!(!is_out(&mut bench) && height_mm(&mut bench) > 40.0, "{stop}");
    }
    bench.host.send_raw(b"M999\n").unwrap();
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    bench.host.send("M401").unwrap();
    assert!(is_out(&mut bench));
    bench.host.send_raw(b"M112\n").unwrap();
    bench.pass(1_000);
    assert!(!is_out(&mut bench));
    bench.host.send_raw(b"M999\n").unwrap();
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    bench.host.send("M401").unwrap();
    force_panic(&equipped().image, &mut bench);
    bench.host.wait_for("the panic", |line| line.starts_with("Error:firmware panic")).unwrap();
    bench.pass(1_000);
    assert!(!is_out(&mut bench));
    bench.press_reset();
    bench.host.wait_for("start", |line| line == "start").unwrap();
    bench.host.send("M401").unwrap();
    assert!(is_out(&mut bench));
    bench.press_reset();
    bench.host.wait_for("start", |line| line == "start").unwrap();
    bench.pass(1_000);
    assert!(!is_out(&mut bench));
}
