//! M851 and M290 on machines with and without a probe.

use crate::error::{CommandError, Failure};
use crate::motion::homing::tests::rig::{Event, MM, Rig, RigPrinter, execute};
use crate::settings::profile::homing::{HomeSensor, SafeHoming};

fn rig(probe_z_10nm: i64) -> Rig {
    Rig::new(|profile| {
        profile.homing[2].sensor = HomeSensor::Probe;
        profile.safe_homing = SafeHoming {
            raise_10nm: 4 * MM,
            home_at_10nm: Some([150 * MM, 30 * MM]),
            probe_offset_10nm: [-29 * MM, -3 * MM, probe_z_10nm],
            bed_10nm: [[0, 200 * MM]; 2],
            is_round: false,
        };
    })
}

fn out_of_range(outcome: Result<(), Failure>) -> [f64; 2] {
    match outcome {
        Err(Failure::Command(CommandError::OutOfRange { minimum, maximum, .. })) => [minimum, maximum],
        other => panic!("{other:?}"),
    }
}

/// A homed machine, where a print would begin.
fn at_z0(rig: &Rig) -> RigPrinter<'_> {
    let mut printer = rig.printer();
    for line in ["G28", "G1 Z0 F600"] {
        execute(&mut printer, line).unwrap();
    }
    rig.take_events();
    rig.last_texts();
    printer
}

#[test]
fn an_offset_is_told_and_set() {
    let rig = rig(0);
    let mut printer = rig.printer();
    execute(&mut printer, "M851").unwrap();
    assert_eq!(rig.last_texts(), ["echo:; Z-Probe Offset:\necho:  M851 X-29.00 Y-3.00 Z0.00 ; (mm)"]);
    execute(&mut printer, "M851 Y5 Z-1.25").unwrap();
    execute(&mut printer, "M851").unwrap();
    assert_eq!(rig.last_texts(), ["echo:; Z-Probe Offset:\necho:  M851 X-29.00 Y5.00 Z-1.25 ; (mm)"]);
    // A refused line has no effect.
    assert_eq!(out_of_range(execute(&mut printer, "M851 X-20 Z-10.5")), [-10.0, 5.0]);
    // Where Z homes, at X150 and Y30, the probe has to stay above the bed of 200 mm.
    assert_eq!(out_of_range(execute(&mut printer, "M851 X51")), [-150.0, 50.0]);
    assert_eq!(out_of_range(execute(&mut printer, "M851 Y-31")), [-30.0, 170.0]);
    assert_eq!(printer.interpreter.modal.probe_offset_10nm, [-29 * MM, 5 * MM, -125_000]);
    let rig = Rig::new(|_| ());
    assert!(matches!(execute(&mut rig.printer(), "M851"), Err(Failure::Command(CommandError::NotEquipped(_)))));
}

/// The nozzle moves down at once, the G-code's Z stays, and the next homing keeps the height.
#[test]
fn a_shift_moves_the_nozzle_under_the_g_code_and_is_kept() {
    let rig = rig(0);
    let mut printer = at_z0(&rig);
    execute(&mut printer, "M290 Z-0.1").unwrap();
    assert_eq!(rig.last_texts(), ["echo:Probe Offset Z-0.10"]);
    let down = |mm: f64| Event::Moved([0.0, 0.0, mm], 10.0);
    assert_eq!(rig.take_events(), [down(-0.1)]);
    execute(&mut printer, "M290 S-0.1").unwrap();
    assert_eq!((printer.interpreter.modal.machine_10nm[2], printer.logical_10nm()[2]), (0, 0));
    execute(&mut printer, "G1 X100 Z0.2").unwrap();
    assert_eq!((rig.true_mm()[2], printer.logical_10nm()[2]), (0.0, 20_000));
    rig.last_texts();
    execute(&mut printer, "M290").unwrap();
    assert_eq!(rig.last_texts(), ["echo:Probe Offset Z-0.20", "echo:Babystep Z-0.20"]);
    // The same height again, from the offset and without a shift.
    for line in ["G28 Z", "G1 Z0.2"] {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!((rig.true_mm()[2], printer.interpreter.modal.z.shift_10nm), (0.0, 0));
    // With P0 the offset stays, and homing ends the shift.
    execute(&mut printer, "M290 P0 Z0.5").unwrap();
    assert_eq!((rig.true_mm()[2], printer.interpreter.modal.probe_offset_10nm[2]), (0.5, -20_000));
    execute(&mut printer, "G28 Z").unwrap();
    assert_eq!(rig.true_mm()[2], 4.0 - 0.2);
}

#[test]
fn a_shift_has_limits() {
    let rig = rig(-MM / 2);
    let mut printer = rig.printer();
    assert_eq!(execute(&mut printer, "M290 Z-0.1"), Err(Failure::Command(CommandError::ShiftsHomedZ)));
    let mut printer = at_z0(&rig);
    assert_eq!(out_of_range(execute(&mut printer, "M290 Z-1.01")), [-1.0, 1.0]);
    for line in ["M290 Z-1", "M290 Z-0.6"] {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!(out_of_range(execute(&mut printer, "M290 Z-0.5")), [-0.4, 3.6]);
    // During a prepared job the shift is refused, and the job continues.
    printer.interpreter.modal.in_prepared_job = true;
    assert_eq!(execute(&mut printer, "M290 Z0.1"), Err(Failure::Command(CommandError::ShiftsNoJob)));
    printer.interpreter.modal.in_prepared_job = false;
    for line in ["M290 X1", "M290 Z1 Y1", "M290 E1", "M290 X40 Y40 Z2.6666666"] {
        execute(&mut printer, line).unwrap();
        assert!(rig.last_texts().concat().contains("M290 shifts only Z"), "{line}");
    }
    assert_eq!((rig.true_mm()[2], printer.interpreter.modal.z.shift_10nm), (-0.5 - 1.6, -160_000));
    // The offset must not leave its range either.
    execute(&mut printer, "M851 Z-9.9").unwrap();
    execute(&mut printer, "G28 Z").unwrap();
    assert_eq!(out_of_range(execute(&mut printer, "M290 Z-0.2")), [-0.1, 14.9]);
    execute(&mut printer, "M290 Z-0.2 P0").unwrap();
}

/// A lift, a stop and the upper end of the travel preserve the shift.
#[test]
fn a_shift_lasts_through_lifts_and_stays_below_the_top() {
    let rig = Rig::new(|profile| {
        profile.retraction.length_10nm = MM;
        profile.retraction.lift_10nm = 2 * MM;
    });
    let mut printer = rig.printer();
    for line in ["G28", "M302 P1", "G1 Z10 F600", "M290 Z0.5", "G10"] {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!(rig.true_mm()[2], 12.5);
    execute(&mut printer, "G11").unwrap();
    assert_eq!(rig.true_mm()[2], 10.5);
    execute(&mut printer, "M410").unwrap();
    assert_eq!((printer.interpreter.modal.machine_10nm[2], printer.interpreter.modal.z.shift_10nm), (10 * MM, MM / 2));
    execute(&mut printer, "G1 Z200").unwrap();
    assert_eq!(rig.true_mm()[2], 200.0);
    execute(&mut printer, "G1 Z100").unwrap();
    assert_eq!(rig.true_mm()[2], 100.5);
    // Homing another axis preserves it as well.
    execute(&mut printer, "G28 X").unwrap();
    assert_eq!((rig.believed_mm()[2], printer.interpreter.modal.machine_10nm[2]), (100.5, 100 * MM));
}

/// Klipper's offset: the nozzle follows with its next move along Z, and homing preserves it.
#[test]
fn an_offset_is_followed_by_the_next_move_along_z() {
    let rig = Rig::new(|_| ());
    let mut printer = rig.printer();
    for line in ["G28", "SET_GCODE_OFFSET Z=-0.005", "G1 X20 F3000"] {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!((rig.true_mm()[2], printer.logical_10nm()[2]), (0.0, 500));
    execute(&mut printer, "G1 X30 Z0.2").unwrap();
    assert_eq!((rig.true_mm()[2], printer.logical_10nm()[2]), (0.195, 20_000));
    // Moved at once, and added; in mm whatever the unit.
    for line in ["G20", "SET_GCODE_OFFSET Z_ADJUST=0.105 MOVE=1", "G21"] {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!((rig.true_mm()[2], printer.logical_10nm()[2]), (0.3, 20_000));
    // A relative move starts where the nozzle is.
    for line in ["SET_GCODE_OFFSET Z=0", "G91", "G1 Z1", "G90"] {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!((rig.true_mm()[2], printer.logical_10nm()[2]), (1.3, 130_000));
    execute(&mut printer, "G1 Z1").unwrap();
    assert_eq!(rig.true_mm()[2], 1.0);
}

#[test]
fn an_offset_before_homing_lasts_through_it() {
    let rig = Rig::new(|_| ());
    let mut printer = rig.printer();
    for line in ["SET_GCODE_OFFSET Z=0.1 MOVE=1", "G28", "G1 X20 F3000"] {
        execute(&mut printer, line).unwrap();
    }
    // The nozzle stays at home, which the G-code sees 0.1 mm lower: no limit raises it.
    assert_eq!((rig.true_mm()[2], printer.logical_10nm()[2], printer.tally().clamped_moves), (0.0, -10_000, 0));
    for line in ["G1 Z0.2", "G28 Z", "G1 Z0.2", "M290 Z0.05", "G28 Z", "G1 Z0.2"] {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!(rig.true_mm()[2], 0.3);
    assert_eq!(out_of_range(execute(&mut printer, "SET_GCODE_OFFSET Z=2.1")), [-2.0, 2.0]);
    assert_eq!(out_of_range(execute(&mut printer, "SET_GCODE_OFFSET Z_ADJUST=1.95")), [-2.0, 2.0]);
    printer.interpreter.modal.in_prepared_job = true;
    let refused = execute(&mut printer, "SET_GCODE_OFFSET Z=0");
    assert_eq!(refused, Err(Failure::Command(CommandError::ShiftsNoJob)));
    execute(&mut printer, "SET_GCODE_OFFSET Z=0.1").unwrap();
}
