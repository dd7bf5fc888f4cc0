//! Motor drivers with a serial line: nothing moves before they have confirmed their settings, and
//! one that fails in mid-print stops the print.

use std::cell::RefCell;

use ferrostep_printer::{MotorDrivers, Profile};
use ferrostep_session::desk::{Desk, LOOK_AHEAD_BLOCKS, MotionState};
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::{JobReplies, PrintSession, Session};
use ferrostep_tmc2209::{DriverState, DriverStatus, Register, RegisterImage};
use ferrostep_virtual_board::{DriverChip, VIRTUAL_WIRING};

use crate::end_to_end::desk::{profile, rehearse};
use crate::end_to_end::refusals::Collector;

type Machine = PrintSession<(), Collector>;

fn machine(profile: &Profile) -> Machine {
    Session::print(*profile, LOOK_AHEAD_BLOCKS, (), Collector::default())
}

/// Executes lines. Returns the replies, except `ok` and `busy`.
fn say(machine: &Machine, printer: &mut ferrostep_session::DeskPrinter<'_>, lines: &[&str]) -> Vec<String> {
    let mut replies = Vec::new();
    for (number, line) in (1..).zip(lines) {
        // A refusal is reported.
        let _ = machine.run(printer.execute(number, line));
        replies.extend(
            machine.replies().take().into_iter().filter(|reply| !reply.starts_with("ok") && !reply.contains("busy")),
        );
    }
    replies
}

/// Accesses a motor's chip.
fn with_chip<T>(machine: &Machine, motor: usize, act: impl FnOnce(&mut DriverChip) -> T) -> T {
    machine.drivers().with_lines(|lines| act(lines.chip(motor).unwrap())).unwrap()
}

fn register(machine: &Machine, motor: usize, register: Register) -> u32 {
    with_chip(machine, motor, |chip| chip.register(register))
}

#[test]
fn all_registers_are_written_before_the_first_step() {
    for name in ["prusa-mini", "corexy"] {
        let profile = profile(name);
        let machine = machine(&profile);
        let mut printer = machine.printer();
        assert_eq!(machine.drivers().state(0), Some(DriverState::Unconfirmed));
        assert_eq!(say(&machine, &mut printer, &["G1 X1 F600"]), [""; 0]);
        for (motor, wiring) in VIRTUAL_WIRING.iter().enumerate() {
            let settings = profile.drivers[motor].unwrap();
            for (written, value) in RegisterImage::new(&settings, wiring).unwrap().writes {
                assert_eq!(register(&machine, motor, written), value, "{name} {motor} {written}");
            }
            assert_eq!(machine.drivers().state(motor), Some(DriverState::Confirmed));
        }
    }
}

#[test]
fn drivers_change_no_step() {
    let with = profile("prusa-mini");
    let without = Profile { drivers: [None; 4], ..with };
    // This machine homes by its drivers' stall signals.
    let program = "M302 P1\nG1 X90 Y80 Z3 F6000\nG1 X10 E4 F1800\nG2 X20 Y90 I10 J0\nG10\nG11\n";
    let [with, without] = [with, without].map(|profile| {
        let ended = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut program.as_bytes());
        ended.outcome.unwrap();
        (ended.figures.digests, ended.figures.motor_steps, ended.figures.motion_time_s)
    });
    assert_eq!(with, without);
}

#[test]
fn a_silent_driver_blocks_motion_only() {
    let profile = profile("prusa-mini");
    let machine = machine(&profile);
    let mut printer = machine.printer();
    with_chip(&machine, 1, |chip| chip.set_silent(true));
    let replies = say(&machine, &mut printer, &["M104 S50", "G28", "G1 X5 F600", "G10", "M122"]);
    let reason = "driver Y does not answer: no reply on its serial line; is the motor supply on?";
    assert_eq!(replies[0], format!("echo:{reason}"));
    assert_eq!(replies[1..3], [format!("Error:{reason}"), format!("echo:line 2: {reason}")]);
    assert_eq!(replies[3..5], [format!("Error:{reason}"), format!("echo:line 3: {reason}")]);
    assert_eq!(machine.figures().motor_steps, [0; 4]);
    assert!(
        replies.iter().any(|reply| reply.starts_with("echo:driver X: confirmed, 337 mA, 337 mA at rest")),
        "{replies:#?}"
    );
    assert!(replies.iter().any(|reply| reply.starts_with("echo:driver Y: failed, ")), "{replies:#?}");
    // Once the supply is back, the driver is set up within two seconds.
    with_chip(&machine, 1, |chip| {
        chip.reset();
        chip.set_silent(false);
    });
    let replies = say(&machine, &mut printer, &["G4 S3", "G28"]);
    assert_eq!(replies.len(), 1, "{replies:?}");
    assert!(replies[0].starts_with("X:176.40 Y:24.10 Z:4.00"), "{replies:?}");
}

/// Until a driver is set up it uses the chip's current after a reset: more than twice that of
/// the MINI's motors.
#[test]
fn m17_waits_for_the_drivers() {
    let profile = profile("prusa-mini");
    let machine = machine(&profile);
    let mut printer = machine.printer();
    let motors_on = || machine.desk().state().enabled_motors();
    (0..4).for_each(|motor| with_chip(&machine, motor, |chip| chip.set_silent(true)));
    let reason = "driver X does not answer: no reply on its serial line; is the motor supply on?";
    let replies = say(&machine, &mut printer, &["M17", "M17 E"]);
    for line in 1..=2 {
        assert!(replies.contains(&format!("echo:line {line}: {reason}")), "{replies:#?}");
    }
    assert_eq!(motors_on(), 0);
    for motor in 0..4 {
        with_chip(&machine, motor, |chip| {
            chip.reset();
            chip.set_silent(false);
        });
    }
    assert_eq!(say(&machine, &mut printer, &["G4 S3", "M17 E"]), [""; 0]);
    assert_eq!(motors_on(), 0b1000);
}

/// Moves by other commands than G0 to G3 are refused as well: right after the start they would be
/// made with the steps and currents of unset drivers.
#[test]
fn pauses_filament_changes_and_shifts_of_z_wait_for_the_drivers() {
    let profile = profile("prusa-mini");
    let machine = machine(&profile);
    let mut printer = machine.printer();
    (0..4).for_each(|motor| with_chip(&machine, motor, |chip| chip.set_silent(true)));
    let reason = "driver X does not answer: no reply on its serial line; is the motor supply on?";
    for command in ["M125", "M600", "M701", "M702", "M290 Z0.1"] {
        let replies = say(&machine, &mut printer, &["M302 P1", command]);
        assert!(replies.contains(&format!("echo:line 2: {reason}")), "{command}: {replies:#?}");
    }
    assert_eq!(machine.desk().motor_steps(), [0; 4]);
}

/// M84 X unhomes X and Y on CoreXY, where each of the motors A and B moves both; on the
/// others Y stays homed.
#[test]
fn switching_a_motor_off_unhomes_its_axis() {
    for (name, size_mm, off, homed) in [
        ("corexy", 300, "M84 X", [false, false, true]),
        ("corexy", 300, "M18 Y", [false, false, true]),
        ("corexy", 300, "M84 Z", [true, true, false]),
        ("corexy", 300, "M84 E", [true; 3]),
        ("cartesian", 200, "M84 X", [false, true, true]),
        ("cartesian", 200, "M84 Y", [true, false, true]),
    ] {
        let machine = machine(&profile(name));
        let mut printer = machine.printer();
        say(&machine, &mut printer, &["G28", off]);
        for (axis, homed) in ["X", "Y", "Z"].iter().zip(homed) {
            // Soft limits hold a homed axis only.
            let replies = say(&machine, &mut printer, &[&format!("G0 {axis}{}", size_mm + 1)]);
            let is_held = replies.iter().any(|reply| reply.contains("outside the soft limits"));
            assert_eq!(is_held, homed, "{name}, {off}, {axis}: {replies:?}");
        }
    }
}

/// A print that is under way, and the replies after a fault.
fn fault_in_mid_print(fault: impl FnOnce(&mut DriverChip)) -> (Machine, Vec<String>) {
    let profile = profile("prusa-mini");
    let machine = machine(&profile);
    let mut printer = machine.printer();
    let before = say(&machine, &mut printer, &["G28", "M104 S200", "G1 X170 F300", "G1 X10", "G1 X170"]);
    assert_eq!(before.len(), 1, "{before:?}");
    with_chip(&machine, 0, fault);
    let replies = say(&machine, &mut printer, &["G1 X10 F300", "M400", "G4 S1", "M104 S200", "G1 X5"]);
    (machine, replies)
}

#[test]
fn a_driver_reset_halts_the_print_and_is_set_up_again() {
    let (machine, replies) = fault_in_mid_print(DriverChip::reset);
    assert_eq!(replies[0], "Error:driver X has been reset, its motor may have moved");
    assert_eq!(replies[1], "Error:Printer halted. kill() called!");
    assert!(replies[2..].iter().all(|reply| reply.contains("halted") || reply.contains("stopped")), "{replies:#?}");
    let steps = machine.figures().motor_steps;
    let mut printer = machine.printer();
    // The machine stays halted whatever the driver reports.
    let refused = say(&machine, &mut printer, &["G1 X100", "G28"]);
    assert!(refused.iter().all(|reply| reply.contains("halted")), "{refused:?}");
    assert_eq!(machine.figures().motor_steps, steps);
    let replies = say(&machine, &mut printer, &["M999", "G4 S1", "G28", "G1 X10 F6000", "M400"]);
    assert_eq!(replies.len(), 1, "{replies:?}");
    assert_eq!(machine.drivers().state(0), Some(DriverState::Confirmed));
    assert_eq!(register(&machine, 0, Register::Gstat), 0);
    assert_ne!(register(&machine, 0, Register::Gconf), 0x101);
}

#[test]
fn driver_over_temperature_halts_its_warning_does_not() {
    let (_, replies) = fault_in_mid_print(|chip| chip.set_flags(DriverStatus::OVER_TEMPERATURE));
    assert_eq!(replies[0], "Error:driver X has switched its motor off: over-temperature, switched off");
    assert_eq!(replies[1], "Error:Printer halted. kill() called!");
    let (_, replies) = fault_in_mid_print(|chip| chip.set_flags(DriverStatus::OVER_TEMPERATURE_WARNING));
    assert_eq!(replies, ["echo:driver X warns: over-temperature warning"]);
}

#[test]
fn a_driver_fault_stops_a_job_with_its_message() {
    let notices = RefCell::new(Vec::new());
    let replies = JobReplies::new(|text: &str| notices.borrow_mut().push(text.to_owned()));
    let session = Session::print(profile("prusa-mini"), LOOK_AHEAD_BLOCKS, (), replies);
    session.drivers().with_lines(|lines| lines.chip(3).unwrap().set_silent(true)).unwrap();
    let mut progress = JobProgress::default();
    let mut printer = session.printer();
    let error =
        session.run(job::run(&mut &b"M107\nG28\nG1 X5\n"[..], &mut printer, &mut progress, |_| {})).unwrap_err();
    assert_eq!(
        error.to_string(),
        "line 2: \"G28\": driver E does not answer: no reply on its serial line; is the motor supply on?"
    );
    assert_eq!(notices.borrow().len(), 2, "{notices:?}");
}

#[test]
fn settings_are_changed_reported_and_refused() {
    let profile = profile("prusa-mini");
    let machine = machine(&profile);
    let mut printer = machine.printer();
    let (run, global, threshold, chopper) =
        (Register::IholdIrun, Register::Gconf, Register::Sgthrs, Register::Tpwmthrs);
    say(&machine, &mut printer, &["G1 X1 F600"]);
    assert_eq!(say(&machine, &mut printer, &["M906 X500 E300", "M569 S0 X Y", "M914 X70", "M913 Z8"]), [""; 0]);
    // 0.13 ohm at 0.18 V: 500 mA are 16 of 32, 300 mA 10; spreadCycle is bit 2.
    assert_eq!([register(&machine, 0, run), register(&machine, 3, run)], [0x8_0f0f, 0x8_0909]);
    assert_eq!([0, 1, 2].map(|motor| register(&machine, motor, global) & 4), [4, 4, 0]);
    assert_eq!([0, 1].map(|motor| register(&machine, motor, threshold)), [70, 130]);
    // 8 mm/s at 400 steps/mm of 1/8: 102,400 microsteps of 1/256 a second, 117
    // clocks of 12 MHz each.
    assert_eq!([0, 2].map(|motor| register(&machine, motor, chopper)), [0, 117]);
    // In spreadCycle the speed has no effect yet, and it says so.
    assert_eq!(
        say(&machine, &mut printer, &["M913 X120"]),
        ["echo:driver X: spreadCycle, with M569 S1 only above 120 mm/s"]
    );
    assert_eq!(say(&machine, &mut printer, &["M569 S1 X"]), [""; 0]);
    // 192,000 a second, 62.5 clocks each.
    assert_eq!(register(&machine, 0, chopper), 63);
    assert_eq!(
        say(&machine, &mut printer, &["M913 E30", "M913"])[1..],
        [
            "echo:driver X: stealthChop, spreadCycle above 120 mm/s",
            "echo:driver Y: spreadCycle",
            "echo:driver Z: stealthChop, spreadCycle above 8 mm/s",
            "echo:driver E: spreadCycle, with M569 S1 only above 30 mm/s",
        ]
    );
    assert_eq!(say(&machine, &mut printer, &["M569 S0 X", "M913 X0 Z0"]), [""; 0]);
    assert_eq!(
        say(&machine, &mut printer, &["M906", "M569 X Z", "M914"])[..6],
        [
            "echo:driver X: 500 mA (490 mA, 490 mA at rest)",
            "echo:driver Y: 350 mA (337 mA, 337 mA at rest)",
            "echo:driver Z: 350 mA (337 mA, 337 mA at rest)",
            "echo:driver E: 300 mA (306 mA, 306 mA at rest)",
            "echo:driver X: spreadCycle",
            "echo:driver Z: stealthChop",
        ]
    );
    // A setting that does not exist leaves the others as they are.
    assert_eq!(
        say(&machine, &mut printer, &["M906 X600 Y2500"]),
        ["echo:line 1: Y: a current of 2500 mA is out of range, expected 31 to 1768 mA"]
    );
    assert_eq!(register(&machine, 0, run), 0x8_0f0f);
}

#[test]
fn driver_commands_without_drivers_say_so() {
    let profile = profile("cartesian");
    let machine = machine(&profile);
    let mut printer = machine.printer();
    let replies = say(&machine, &mut printer, &["M122", "M569 S1 X", "M906 X800", "M913 X100", "M914", "G28"]);
    for (reply, command) in replies.iter().zip(["M122", "M569", "M906", "M913", "M914"]) {
        assert_eq!(*reply, format!("echo:{command}: not available, this machine's drivers cannot be set"));
    }
    assert_eq!(replies.len(), 6);
}
