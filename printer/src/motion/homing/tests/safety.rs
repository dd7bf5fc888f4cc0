//! The nozzle and the bed: the place where Z homes, the rise before, and approaches
//! that do not agree.

use super::*;
use crate::settings::profile::homing::SafeHoming;

/// Raise, place and probe of the machine below, mm.
const RAISE: f64 = 4.0;
const HOME_AT: [f64; 2] = [150.0, 30.0];

fn units(mm: f64) -> i64 {
    (mm * MM as f64) as i64
}

/// A machine with a probe that triggers when the nozzle is at 0 of its frame.
fn rig_with_probe(probe_z_mm: f64) -> Rig {
    Rig::new(|profile| {
        profile.homing[2].sensor = HomeSensor::Probe;
        profile.safe_homing = SafeHoming {
            raise_10nm: units(RAISE),
            home_at_10nm: Some(HOME_AT.map(units)),
            probe_offset_10nm: [-29.0, -3.0, probe_z_mm].map(units),
            bed_10nm: [[0, 200 * MM]; 2],
            is_round: false,
        };
    })
}

fn ways(events: &[Event], axis: usize) -> Vec<f64> {
    let of = |event: &Event| match event {
        Event::Sought(sought, way, _) if *sought == axis => Some(*way),
        _ => None,
    };
    events.iter().filter_map(of).collect()
}

/// Raised first, X and Y, over the bed, down, and off it again.
#[test]
fn the_order_of_a_machine_with_a_probe() {
    let rig = rig_with_probe(-1.0);
    let mut printer = rig.printer();
    execute(&mut printer, "G28").unwrap();
    let events = rig.take_events();
    let expected = [Event::Homing, Event::Moved([0.0, 0.0, RAISE], FAST), Event::Sought(0, -REACH, FAST)];
    assert_eq!(events[..3], expected);
    let travel = events.iter().position(|event| *event == Event::Moved([HOME_AT[0], HOME_AT[1], 0.0], FAST)).unwrap();
    let sought =
        |axis| events.iter().position(|event| matches!(event, Event::Sought(one, ..) if *one == axis)).unwrap();
    assert!(sought(0) < sought(1) && sought(1) < travel && travel < sought(2));
    // The probe has triggered 1 mm above the bed, and at the end the nozzle is 4 mm above it.
    let n = events.len();
    let expected = [
        Event::Placed([HOME_AT[0], HOME_AT[1], 1.0]),
        Event::Homing,
        Event::Moved([0.0, 0.0, RAISE - 1.0], FAST),
        Event::Placed([HOME_AT[0], HOME_AT[1], RAISE]),
    ];
    assert_eq!(events[n - 4..], expected);
    assert_eq!(printer.interpreter.modal.machine_10nm, [units(HOME_AT[0]), units(HOME_AT[1]), units(RAISE)]);
    // For an unknown Z: from the highest frame to half a millimetre below the trigger at 1 mm.
    assert_eq!(ways(&events, 2)[0], -REACH + 1.0 - PRESS);
    // From a known height Z is not raised, and Z alone homes there as well.
    execute(&mut printer, "G1 X0 Y0 Z50 F6000").unwrap();
    rig.take_events();
    execute(&mut printer, "G28 Z").unwrap();
    let events = rig.take_events();
    assert_eq!(events[..2], [Event::Homing, Event::Moved([HOME_AT[0], HOME_AT[1], 0.0], FAST)]);
    // Known: from 50 mm to the trigger at 1 mm, and half a millimetre.
    assert_eq!(ways(&events, 2), [-49.5, -BACK_OFF - PRESS]);
}

#[test]
fn z_is_not_homed_where_x_and_y_are_not_known() {
    let rig = rig_with_probe(0.0);
    let mut printer = rig.printer();
    for (line, axis) in [("G28 Z", 0), ("G28 X Z", 1), ("G28 Y Z", 0)] {
        let outcome = execute(&mut printer, line);
        assert_eq!(outcome, refused(CommandError::HomeFirst { axis }), "{line}");
        assert_eq!((rig.take_events(), rig.enabled()), (vec![], 0), "{line}");
    }
    assert!(rig.last_texts().iter().any(|text| text.contains("X is not homed") && text.ends_with("G28")));
    execute(&mut printer, "G28 X Y").unwrap();
    execute(&mut printer, "G28 Z").unwrap();
    // A motor without current may have been turned.
    execute(&mut printer, "M84 Y").unwrap();
    assert_eq!(execute(&mut printer, "G28 Z"), refused(CommandError::HomeFirst { axis: 1 }));
}

/// Only once from an unknown height, else homing would climb; anew when the motors were
/// off; and never down.
#[test]
fn z_is_raised_before_x_and_y() {
    let rig = rig_with_probe(0.0);
    let mut printer = rig.printer();
    let raised = |printer: &mut RigPrinter<'_>, line| {
        let before = rig.true_mm()[2];
        execute(printer, line).unwrap();
        rig.true_mm()[2] - before
    };
    assert_eq!(raised(&mut printer, "G28 X"), RAISE);
    assert_eq!(raised(&mut printer, "G28 Y"), 0.0);
    assert_eq!(printer.interpreter.modal.machine_10nm[2], units(RAISE));
    execute(&mut printer, "M84").unwrap();
    assert_eq!(raised(&mut printer, "G28 X"), RAISE);
    execute(&mut printer, "G28").unwrap();
    execute(&mut printer, "G1 Z1 F600").unwrap();
    assert_eq!(raised(&mut printer, "G28 X"), RAISE - 1.0);
    execute(&mut printer, "G1 Z80 F600").unwrap();
    assert_eq!(raised(&mut printer, "G28 X Y"), 0.0);
    // Without the key Z is not raised.
    let rig = Rig::new(|_| ());
    execute(&mut rig.printer(), "G28 X").unwrap();
    assert_eq!(rig.true_mm()[2], 40.0);
}

/// M851 in between does not move the place where the motors know that the probe triggers.
#[test]
fn a_new_offset_is_searched_for_where_the_probe_triggers() {
    let rig = rig_with_probe(0.0);
    let mut printer = rig.printer();
    execute(&mut printer, "G28").unwrap();
    execute(&mut printer, "M851 Z-2.5").unwrap();
    rig.take_events();
    execute(&mut printer, "G28 Z").unwrap();
    assert_eq!(ways(&rig.take_events(), 2), [-RAISE - PRESS, -BACK_OFF - PRESS]);
    // The probe triggers at 2.5 now, so that the nozzle's 4 mm are 1.5 above that.
    assert_eq!(rig.true_mm()[2], RAISE - 2.5);
    execute(&mut printer, "G1 Z0").unwrap();
    assert_eq!(rig.true_mm()[2], -2.5);
}

#[test]
fn approaches_that_agree_at_the_second_attempt_home() {
    let rig = Rig::new(|_| ());
    let mut printer = rig.printer();
    // The first ends 20 mm too early, so that the second does not find anything there.
    rig.early_10nm.replace(vec![20 * MM]);
    execute(&mut printer, "G28 X").unwrap();
    assert_eq!(ways(&rig.take_events(), 0), [-REACH, -10.0, -REACH, -10.0]);
    assert_eq!(rig.true_mm()[0], 0.0);
    // The second is a spike.
    rig.early_10nm.replace(vec![2 * MM, 0]);
    execute(&mut printer, "G28 Y").unwrap();
    assert_eq!(rig.true_mm()[1], 0.0);
    assert_eq!(ways(&rig.take_events(), 1).len(), 4);
    // Half a millimetre is near enough.
    rig.early_10nm.replace(vec![MM / 2, 0]);
    execute(&mut printer, "G28 Y").unwrap();
    assert_eq!(ways(&rig.take_events(), 1).len(), 2);
}

/// An axis moves back before the second attempt if it is at its sensor, or if its motor
/// has to become fast.
#[test]
fn the_second_attempt_begins_where_a_sensor_can_tell() {
    let back = Event::Moved(along(0, BACK_OFF), FAST);
    let whole = [Event::Sought(0, -REACH, FAST), back, Event::Sought(0, -2.0 * BACK_OFF, SLOW)];
    for (sensor, early_10nm, before_second) in [
        // The second has met the switch: away from it.
        (HomeSensor::EndStop, vec![0, 0, 0, 3 * MM], vec![back]),
        // The second approach has missed the switch: it continues from there.
        (HomeSensor::EndStop, vec![0, 0, 0, 20 * MM], vec![]),
        (HomeSensor::Stall, vec![0, 0, 0, 20 * MM], vec![back]),
    ] {
        let rig = Rig::new(|profile| profile.homing[0].sensor = sensor);
        rig.early_10nm.replace(early_10nm);
        execute(&mut rig.printer(), "G28 X").unwrap();
        let mut expected = if sensor == HomeSensor::Stall { vec![Event::Homing, back] } else { vec![] };
        expected.extend(whole);
        expected.extend(before_second);
        expected.extend(whole);
        expected.push(Event::Placed([0.0; 3]));
        assert_eq!(rig.take_events(), expected, "{sensor:?}");
    }
}

#[test]
fn approaches_that_disagree_twice_fail_with_the_numbers() {
    let rig = Rig::new(|_| ());
    let mut printer = rig.printer();
    rig.early_10nm.replace(vec![3 * MM, 0, 3 * MM, 0]);
    let outcome = execute(&mut printer, "G28 X");
    let failed = CommandError::HomingDisagrees { axis: 0, apart_10nm: Some(3 * MM), agree_10nm: MM / 2 };
    assert_eq!(outcome, refused(failed));
    assert_eq!((printer.interpreter.modal.homed[0], ways(&rig.take_events(), 0).len()), (false, 4));
    let texts = rig.last_texts();
    assert!(texts.iter().any(|text| text.contains("3.00 mm") && text.contains("at most 0.50 mm")), "{texts:?}");
}

#[test]
fn a_sensor_of_another_axis_is_named() {
    for (axis, other) in [(0, 1), (1, 0)] {
        let rig = Rig::new(|_| ());
        rig.sensors[axis].set(Sensor::WiredTo(other));
        rig.sensors[other].set(Sensor::WiredTo(axis));
        let mut printer = rig.printer();
        let name = crate::AXIS_NAMES[axis];
        let outcome = execute(&mut printer, &format!("G28 {name}"));
        let searched_10nm = units(REACH);
        assert_eq!(outcome, refused(CommandError::HomingFailed { axis, searched_10nm, swapped: Some(other) }));
        let texts = rig.last_texts();
        assert!(texts.iter().any(|text| text.ends_with("are the two swapped?")), "{texts:?}");
    }
}

/// The position of an axis is unknown once its motor has no current.
#[test]
fn motors_without_current_may_have_been_turned() {
    for (kinematics, off, homed) in [
        (Kinematics::Cartesian, "M84 X", [false, true, true]),
        // Motor A moves X and Y.
        (Kinematics::CoreXy, "M84 X", [false, false, true]),
        (Kinematics::CoreXy, "M84 Z", [true, true, false]),
        (Kinematics::Cartesian, "M84", [false; 3]),
    ] {
        let rig = Rig::new(|profile| profile.kinematics = kinematics);
        let mut printer = rig.printer();
        execute(&mut printer, "G28").unwrap();
        assert_eq!(printer.interpreter.modal.z.trigger_10nm, Some(0));
        execute(&mut printer, off).unwrap();
        assert_eq!(printer.interpreter.modal.homed, homed, "{off}");
        assert_eq!(printer.interpreter.modal.z.trigger_10nm.is_some(), homed[2], "{off}");
    }
}

/// The lower ends of the travel are where soft limits clamp, and where an approach ends.
#[test]
fn the_travel_may_begin_below_0() {
    let rig = Rig::new(|profile| profile.lower_end_10nm = [-2 * MM, -3 * MM, 0]);
    let mut printer = rig.printer();
    execute(&mut printer, "G28").unwrap();
    assert_eq!(ways(&rig.take_events(), 1)[0], -REACH - 3.0);
    execute(&mut printer, "G1 X-10 Y-2.5 Z-1 F6000").unwrap();
    assert_eq!(rig.true_mm(), [-2.0, -2.5, 0.0]);
    let texts = rig.last_texts();
    assert!(texts.iter().any(|text| text.contains("X ends at -2.00 (allowed -2.00 to 200.00)")), "{texts:?}");
}
