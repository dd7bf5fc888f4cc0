//! Axes that home by their driver's stall signal: the carriage meets the frame's end, its motor
//! lags, and the chip reports it.

use ferrostep_printer::Profile;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::{DeskPrinter, PrintSession, Session};
use ferrostep_tmc2209::Register;
use ferrostep_virtual_board::START_10NM;

use crate::end_to_end::desk::{profile, rehearse};
use crate::end_to_end::refusals::Collector;

type Machine = PrintSession<(), Collector>;

fn machine(profile: &Profile) -> Machine {
    Session::print(*profile, LOOK_AHEAD_BLOCKS, (), Collector::default())
}

/// Executes lines. Returns the replies, except `ok` and `busy`.
fn say(machine: &Machine, printer: &mut DeskPrinter<'_>, lines: &[&str]) -> Vec<String> {
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

/// True place of the tool head, mm.
fn true_mm(machine: &Machine) -> [f64; 3] {
    machine.desk().true_position_10nm().map(|units| units as f64 / 1e5)
}

/// Threshold 130 means a load of 260, which the model's motor reaches when it lags 0.35 full steps:
/// 6 of its 16 microsteps.
const LAG_MM: f64 = 0.06;

#[test]
fn x_and_y_home_by_stall_against_the_frame() {
    let profile = profile("prusa-mini");
    let machine = machine(&profile);
    let mut printer = machine.printer();
    let replies = say(&machine, &mut printer, &["G28"]);
    // Over the sheet, and off it again.
    assert!(replies[0].starts_with("X:176.40 Y:24.10 Z:4.00"), "{replies:?}");
    // The motor's lag at the signal remains.
    say(&machine, &mut printer, &["G1 X90 Y90 Z10 F6000", "M400"]);
    let [x, y, z] = true_mm(&machine);
    assert!((x - 90.0 - LAG_MM).abs() < 1e-6 && (y - 90.0 + LAG_MM).abs() < 1e-6, "{x} {y}");
    assert_eq!(z, 10.0);
    // The second homing ends at the same place, to the step.
    say(&machine, &mut printer, &["G28 X Y", "G1 X90 Y90 F6000", "M400"]);
    assert_eq!(true_mm(&machine), [x, y, z]);
}

#[test]
fn an_axis_at_its_end_homes() {
    let profile = profile("prusa-mini");
    let machine = machine(&profile);
    let mut printer = machine.printer();
    for _ in 0..3 {
        let replies = say(&machine, &mut printer, &["G28 X"]);
        assert!(replies[0].starts_with("X:180.40"), "{replies:?}");
        assert_eq!(true_mm(&machine)[0], 180.4);
    }
    // Back 2.56 mm, on to the frame, back again, and the second approach.
    let steps = machine.figures().motor_steps[0];
    assert_eq!(steps, (256 + 12_302 + 256 + 256) + 2 * 4 * 256);
    // Z has been raised by 4 mm, once.
    assert_eq!(machine.figures().motor_steps[2], 1_600);
}

#[test]
fn a_wrong_stall_threshold_shows() {
    let profile = profile("prusa-mini");
    // A motor in free motion seems to stall at 250 as soon as its load can be measured: far from
    // the end, and the second approach elsewhere than the first.
    let too_sensitive = machine(&profile);
    let replies = say(&too_sensitive, &mut too_sensitive.printer(), &["M914 X250", "G28 X"]);
    assert!(
        replies[0].starts_with("echo:line 2: homing X failed twice: the second approach met the sensor"),
        "{replies:?}"
    );
    assert!(replies[0].contains("expected at most 0.50 mm"), "{replies:?}");
    let x = true_mm(&too_sensitive)[0];
    assert!(x < START_10NM[0] as f64 / 1e5 + 5.0, "{x}");
    // A load of 2 means a lag of a full step: later, but it comes.
    let late = machine(&profile);
    let replies = say(&late, &mut late.printer(), &["M914 X1", "G28 X"]);
    assert!(replies[0].starts_with("X:180.40"), "{replies:?}");
    assert_eq!(true_mm(&late)[0], 180.4);
}

#[test]
fn homing_without_a_stall_signal_is_refused() {
    let profile = profile("prusa-mini");
    for off in ["M914 X0", "M569 S0 X", "M913 X40"] {
        let machine = machine(&profile);
        let replies = say(&machine, &mut machine.printer(), &[off, "G28 X"]);
        let expected =
            "echo:line 2: X homes by its driver's stall signal, which is off: send M914 X1 to 255, M569 S1 X, M913 X0";
        assert_eq!(replies, [expected]);
        assert_eq!(machine.figures().motor_steps, [0; 4]);
    }
}

#[test]
fn a_stall_of_a_slow_motor_is_ignored() {
    // The profile's check would refuse this speed: 20 mm/s are 125 full steps a second, below what
    // TCOOLTHRS admits.
    let mut profile = profile("prusa-mini");
    profile.homing[0].fast_mm_per_s = 20.0;
    profile.homing[0].slow_mm_per_s = 20.0;
    let machine = machine(&profile);
    let replies = say(&machine, &mut machine.printer(), &["G28 X"]);
    assert_eq!(
        replies,
        [
            "echo:line 1: homing X failed: its sensor did not trigger within 192.4 mm, expected it at the end of the axis: is \
             it connected, or swapped with another's (M119)?"
        ]
    );
    // It has pushed against the frame, and fallen back each time by four full steps.
    let x = true_mm(&machine)[0];
    assert!(x > 179.4 && x <= 180.4, "{x}");
}

#[test]
fn the_chips_registers_decide_about_stalls() {
    let profile = profile("prusa-mini");
    let machine = machine(&profile);
    let mut printer = machine.printer();
    say(&machine, &mut printer, &["G28 X"]);
    let held = |register| machine.drivers().with_lines(|lines| lines.chip(0).unwrap().register(register)).unwrap();
    assert_eq!((held(Register::Sgthrs), held(Register::Tcoolthrs)), (130, 312));
    say(&machine, &mut printer, &["M914 X77"]);
    assert_eq!(held(Register::Sgthrs), 77);
}

#[test]
fn a_corexy_stall_holds_both_motors() {
    let text = ferrostep_profiles::builtin_text("corexy").unwrap();
    let text = text
        .replacen("sensor = \"end-stop\"", "sensor = \"stall\"", 2)
        .replacen("slow_mm_per_s = 10", "slow_mm_per_s = 40", 2)
        .replacen("stealth_chop = false", "stealth_chop = true", 2)
        .replacen("stall_threshold = 0", "stall_threshold = 100", 2);
    let profile = ferrostep_profiles::parse(&text, "stall.toml").unwrap();
    let machine = machine(&profile);
    let mut printer = machine.printer();
    let replies = say(&machine, &mut printer, &["G28", "G1 X100 Y120 F6000", "M400"]);
    assert!(replies[0].starts_with("X:295.00 Y:295.00 Z:0.00"), "{replies:?}");
    let [x, y, _] = true_mm(&machine);
    assert!((x - 100.0).abs() < 0.2 && (y - 120.0).abs() < 0.2, "{x} {y}");
}

/// The nozzle prints at the height that the probe's offset says, to the step, from places all
/// over the machine.
#[test]
fn the_probe_offset_places_the_first_layer() {
    let mut profile = profile("prusa-mini");
    profile.safe_homing.probe_offset_10nm[2] = -110_000;
    for place in ["X0 Y0 Z0", "X100 Y-40 Z150", "X-50 Y120 Z-8", "X119 Y129 Z20"] {
        let machine = machine(&profile);
        let mut printer = machine.printer();
        let replies = say(&machine, &mut printer, &[&format!("G1 {place} F6000"), "G28"]);
        assert!(replies[0].starts_with("X:176.40 Y:24.10 Z:4.00"), "{place}: {replies:?}");
        say(&machine, &mut printer, &["G1 X90 Y90 Z0.2 F6000", "M400"]);
        assert_eq!(true_mm(&machine)[2], 0.2, "{place}");
        // The paper says that the nozzle is too high by a tenth; a second homing
        // keeps the correction.
        let replies = say(&machine, &mut printer, &["M290 Z-0.1", "M114", "M400"]);
        assert_eq!(replies[0], "echo:Probe Offset Z-1.20");
        assert!(replies[1].starts_with("X:90.00 Y:90.00 Z:0.20"), "{replies:?}");
        assert!((true_mm(&machine)[2] - 0.1).abs() < 1e-9, "{place}");
        say(&machine, &mut printer, &["G28", "G1 X90 Y90 Z0.2 F6000", "M400"]);
        assert!((true_mm(&machine)[2] - 0.1).abs() < 1e-9, "{place}");
    }
}

#[test]
fn a_cube_prints_after_homing_by_stall() {
    let profile = profile("prusa-mini");
    let cube = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/cube.gcode")).unwrap();
    let ended = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut cube.as_slice());
    ended.outcome.unwrap();
    // The slicer's end is at Y220, which soft limits make 180.
    assert_eq!(ended.notices.len(), 1, "{:?}", ended.notices);
    assert_eq!(ended.figures.underruns, 0);
}
