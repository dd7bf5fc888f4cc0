//! Moves of homing, and the machine's state after it, whatever the sensors do.

mod pin;
pub mod rig;
mod safety;

use ferrostep_planner::Kinematics;
use ferrostep_tmc2209::DriverSettings;

use super::*;
use crate::error::Failure;
use crate::ports::Equipment;
use rig::{Drivers, Event, MM, Rig, RigPrinter, Sensor, execute};

/// The profile's homing: mm and mm/s.
const FAST: f32 = 50.0;
const SLOW: f32 = 25.0;
const BACK_OFF: f64 = 5.0;

/// The axes' length with the frame's possible excess, mm.
const REACH: f64 = rig::SIZE_MM as f64 + 5.0;

/// Maximum distance of an approach of Z below the place where its sensor must trigger, mm.
const PRESS: f64 = 0.5;

/// Maximum length of a first approach: that of an unknown Z ends a little below the bed of
/// the lowest machine.
fn reach(axis: usize) -> f64 {
    if axis == 2 { REACH + PRESS } else { REACH }
}

/// Maximum length of a second approach.
fn second(axis: usize) -> f64 {
    if axis == 2 { BACK_OFF + PRESS } else { 2.0 * BACK_OFF }
}

fn refused(error: CommandError) -> Result<(), Failure> {
    Err(Failure::Command(error))
}

/// A way along one axis.
fn along(axis: usize, distance_mm: f64) -> [f64; 3] {
    core::array::from_fn(|one| if one == axis { distance_mm } else { 0.0 })
}

/// All three axes of a machine whose sensors are not at 0: X homes to its upper end.
#[test]
fn a_fast_approach_a_way_back_and_a_slow_approach() {
    let rig = Rig::new(|profile| {
        profile.homing[0].end = HomeEnd::Max;
        profile.homing[0].position_10nm = 200 * MM;
        profile.homing[1].position_10nm = -3 * MM;
    });
    let mut printer = rig.printer();
    assert_eq!(execute(&mut printer, "G28"), Ok(()));
    let mut expected = Vec::new();
    let mut place = [0.0; 3];
    for (axis, towards, home) in [(0, 1.0, 200.0), (1, -1.0, -3.0), (2, -1.0, 0.0)] {
        place[axis] = home;
        expected.extend([
            Event::Sought(axis, towards * reach(axis), FAST),
            Event::Moved(along(axis, -towards * BACK_OFF), FAST),
            Event::Sought(axis, towards * second(axis), SLOW),
            Event::Placed(place),
        ]);
    }
    assert_eq!(rig.take_events(), expected);
    assert_eq!(rig.true_mm(), [200.0, 0.0, 0.0]);
    assert_eq!(printer.interpreter.modal.machine_10nm, [200 * MM, -3 * MM, 0]);
    assert_eq!(printer.interpreter.modal.homed, [true; 3]);
    assert_eq!(rig.enabled(), 0b111);
}

#[test]
fn only_what_is_named_is_homed() {
    let rig = Rig::new(|_| ());
    let mut printer = rig.printer();
    execute(&mut printer, "G92 X7 Y8 Z9").unwrap();
    execute(&mut printer, "G28 Y").unwrap();
    assert_eq!(printer.interpreter.modal.homed, [false, true, false]);
    assert_eq!(rig.true_mm(), [60.0, 0.0, 40.0]);
    assert_eq!(rig.enabled(), 0b010);
    // Homing ends G92's offset of its axis, and of no other.
    assert_eq!(printer.logical_10nm(), [7 * MM, 0, 9 * MM, 0]);
    rig.take_events();
    execute(&mut printer, "G28 X Z").unwrap();
    assert_eq!(printer.interpreter.modal.homed, [true; 3]);
    let sought = rig.take_events().into_iter().filter_map(|event| match event {
        Event::Sought(axis, ..) => Some(axis),
        _ => None,
    });
    assert_eq!(sought.collect::<Vec<_>>(), [0, 0, 2, 2]);
}

/// An axis whose sensor fails after it was homed is no longer homed, and its position is that of
/// its motor. Z goes no lower than just below the place where its sensor triggered before, however
/// often it is tried.
#[test]
fn an_axis_that_does_not_find_its_end_is_not_homed() {
    for (axis, name) in ["X", "Y", "Z"].into_iter().enumerate() {
        let rig = Rig::new(|profile| profile.homing[axis].position_10nm = -2 * MM);
        let mut printer = rig.printer();
        execute(&mut printer, "G28").unwrap();
        rig.sensors[axis].set(Sensor::Dead);
        rig.take_events();
        execute(&mut printer, &format!("G92 {name}30")).unwrap();
        let outcome = execute(&mut printer, &format!("G28 {name}"));
        let searched = if axis == 2 { PRESS } else { REACH };
        let searched_10nm = (searched * MM as f64) as i64;
        assert_eq!(outcome, refused(CommandError::HomingFailed { axis, searched_10nm, swapped: None }));
        let end = -2.0 - searched;
        // No second approach.
        assert_eq!(rig.take_events(), [Event::Sought(axis, -searched, FAST), Event::Placed(along(axis, end))]);
        assert_eq!(printer.interpreter.modal.homed, core::array::from_fn(|one| one != axis));
        assert_eq!(rig.believed_mm(), along(axis, end));
        assert_eq!(printer.interpreter.modal.machine_10nm[axis], (end * MM as f64) as i64);
        // The coordinates are those of before: what G92 said is still there.
        assert_eq!(printer.interpreter.modal.offset_10nm[axis], 32 * MM);
        execute(&mut printer, &format!("G28 {name}")).unwrap_err();
        assert_eq!(rig.believed_mm()[axis], if axis == 2 { end } else { end - REACH });
    }
}

/// Only the frame limits the search of a Z that is not homed. An approach that has gone down all
/// the way is not repeated until the motors were off and a hand may have moved it.
#[test]
fn an_unknown_z_is_searched_once() {
    for off in ["M84", "M18 Z"] {
        let rig = Rig::new(|_| ());
        rig.sensors[2].set(Sensor::Dead);
        let mut printer = rig.printer();
        let search = |printer: &mut RigPrinter<'_>| {
            execute(printer, "G28 Z").unwrap_err();
            rig.take_events().into_iter().find_map(|event| match event {
                Event::Sought(2, way, _) => Some(way),
                _ => None,
            })
        };
        assert_eq!(search(&mut printer), Some(-reach(2)));
        assert_eq!(search(&mut printer), None);
        // The search covers only the height that it was driven up since.
        execute(&mut printer, "G91").unwrap();
        execute(&mut printer, "G1 Z30 F600").unwrap();
        assert_eq!(search(&mut printer), Some(-30.0));
        execute(&mut printer, off).unwrap();
        assert_eq!(search(&mut printer), Some(-reach(2)));
    }
}

#[test]
fn a_sensor_that_is_triggered_away_from_the_end_is_reported() {
    for (axis, name) in ["X", "Y", "Z"].into_iter().enumerate() {
        let rig = Rig::new(|_| ());
        rig.sensors[axis].set(Sensor::Stuck);
        let mut printer = rig.printer();
        printer.interpreter.modal.homed = [true; 3];
        let outcome = execute(&mut printer, &format!("G28 {name}"));
        assert_eq!(outcome, refused(CommandError::SensorStuck { axis }));
        // The fast approach ends at once, the move back does not release the sensor, and
        // there is no slow one.
        assert_eq!(
            rig.take_events(),
            [
                Event::Sought(axis, -reach(axis), FAST),
                Event::Moved(along(axis, BACK_OFF), FAST),
                Event::Placed(along(axis, BACK_OFF))
            ]
        );
        assert_eq!(printer.interpreter.modal.homed, core::array::from_fn(|one| one != axis));
        assert_eq!(printer.interpreter.modal.machine_10nm[axis], 5 * MM);
        assert!(rig.last_texts().iter().any(|text| text.contains(name) && text.starts_with("echo:line 1: ")));
    }
}

#[test]
fn an_axis_that_homes_by_a_stall_goes_back_first() {
    let rig = Rig::new(|profile| profile.homing[1].sensor = HomeSensor::Stall);
    let mut printer = rig.printer();
    execute(&mut printer, "G28 Y").unwrap();
    let back = Event::Moved(along(1, BACK_OFF), FAST);
    assert_eq!(
        rig.take_events(),
        [
            Event::Homing,
            back,
            Event::Sought(1, -REACH, FAST),
            back,
            Event::Sought(1, -2.0 * BACK_OFF, SLOW),
            Event::Placed([0.0; 3])
        ]
    );
    // A driver that reports a stall after the move back always reports one.
    rig.sensors[1].set(Sensor::Stuck);
    assert_eq!(execute(&mut printer, "G28 Y"), refused(CommandError::SensorStuck { axis: 1 }));
    assert_eq!(rig.take_events(), [Event::Homing, back, Event::Placed(along(1, BACK_OFF))]);
    assert_eq!(printer.interpreter.modal.homed, [false; 3]);
}

/// Motors that push against the frame would seem to stall when they move the other axis.
#[test]
fn a_corexy_that_homes_by_a_stall_leaves_the_frame() {
    let rig = Rig::new(|profile| {
        profile.kinematics = Kinematics::CoreXy;
        profile.homing[0] = crate::settings::profile::homing::AxisHoming {
            sensor: HomeSensor::Stall,
            end: HomeEnd::Max,
            position_10nm: 200 * MM,
            ..profile.homing[0]
        };
    });
    let mut printer = rig.printer();
    execute(&mut printer, "G28 X").unwrap();
    let events = rig.take_events();
    let placed = |x: f64| Event::Placed([x, 0.0, 0.0]);
    let back = Event::Moved(along(0, -BACK_OFF), FAST);
    assert_eq!(events[events.len() - 4..], [placed(200.0), Event::Homing, back, placed(195.0)]);
    assert_eq!(rig.true_mm()[0], 195.0);
    assert_eq!((printer.interpreter.modal.machine_10nm[0], printer.interpreter.modal.homed[0]), (195 * MM, true));
    // With a switch at its end it stays there.
    let rig = Rig::new(|profile| profile.kinematics = Kinematics::CoreXy);
    execute(&mut rig.printer(), "G28 X").unwrap();
    assert_eq!(rig.true_mm()[0], 0.0);
}

#[test]
fn a_driver_without_stall_signal_homes_no_axis() {
    const SETTINGS: DriverSettings = DriverSettings {
        current_ma: 500,
        hold_percent: 50,
        microsteps: 16,
        interpolate: true,
        stealth_chop: true,
        spread_cycle_above_mm_per_s: 0,
        steps_per_mm: 100.0,
        stall_threshold: 100,
        both_edges: false,
    };
    for (settings, is_refused) in [
        (SETTINGS, false),
        (DriverSettings { stall_threshold: 0, ..SETTINGS }, true),
        (DriverSettings { stealth_chop: false, ..SETTINGS }, true),
        (DriverSettings { spread_cycle_above_mm_per_s: 30, ..SETTINGS }, true),
        (DriverSettings { spread_cycle_above_mm_per_s: 200, ..SETTINGS }, false),
    ] {
        let drivers = Drivers(settings);
        let rig = Rig::new(|profile| profile.homing[0].sensor = HomeSensor::Stall);
        let mut printer = rig.printer();
        printer.set_drivers(&drivers);
        printer.interpreter.modal.homed = [true; 3];
        let outcome = execute(&mut printer, "G28 X");
        if is_refused {
            assert_eq!(outcome, refused(CommandError::NoStallSignal { axis: 0 }));
            // Nothing has happened: it is where it was.
            assert_eq!((rig.take_events(), printer.interpreter.modal.homed, rig.enabled()), (vec![], [true; 3], 0));
        } else {
            assert_eq!(outcome, Ok(()));
        }
        // Y has a switch.
        assert_eq!(execute(&mut printer, "G28 Y"), Ok(()));
    }
}

/// A machine whose G10 lifts Z by 2 mm.
fn rig_that_lifts() -> Rig {
    Rig::new(|profile| {
        profile.retraction.length_10nm = MM;
        profile.retraction.lift_10nm = 2 * MM;
    })
}

/// Homed, at Z 10, and lifted by G10.
fn lifted(rig: &Rig) -> RigPrinter<'_> {
    let mut printer = rig.printer();
    for line in ["G28", "M302 P1", "G1 Z10 F600", "G10"] {
        execute(&mut printer, line).unwrap();
    }
    printer
}

/// G10 has lifted Z: homing Z ends that, homing another axis does not.
#[test]
fn a_lift_ends_where_z_homes() {
    let rig = rig_that_lifts();
    let mut printer = lifted(&rig);
    assert_eq!((rig.true_mm()[2], printer.interpreter.modal.machine_10nm[2]), (12.0, 10 * MM));
    execute(&mut printer, "G28 X").unwrap();
    // The motors' position includes the lift; the G-code's does not.
    assert_eq!(
        (rig.true_mm()[2], rig.believed_mm()[2], printer.interpreter.modal.machine_10nm[2]),
        (12.0, 12.0, 10 * MM)
    );
    execute(&mut printer, "G28 Z").unwrap();
    assert_eq!((rig.true_mm()[2], rig.believed_mm()[2], printer.interpreter.modal.machine_10nm[2]), (0.0, 0.0, 0));
    execute(&mut printer, "G1 Z5").unwrap();
    assert_eq!(rig.true_mm()[2], 5.0);
    // Nothing is left to lower.
    execute(&mut printer, "G11").unwrap();
    assert_eq!((rig.true_mm()[2], rig.believed_mm()[2]), (5.0, 5.0));
}

#[test]
fn a_lift_ends_where_homing_z_fails_too() {
    let rig = rig_that_lifts();
    let mut printer = lifted(&rig);
    rig.sensors[2].set(Sensor::Dead);
    let searched_10nm = 12 * MM + MM / 2;
    let failed = CommandError::HomingFailed { axis: 2, searched_10nm, swapped: None };
    assert_eq!(execute(&mut printer, "G28 Z"), refused(failed));
    let z_mm = -PRESS;
    assert_eq!((rig.believed_mm()[2], printer.interpreter.modal.machine_10nm[2]), (z_mm, (z_mm * MM as f64) as i64));
    assert_eq!(printer.interpreter.modal.lift_10nm, 0);
}

#[test]
fn without_end_stops_nothing_homes() {
    let rig = Rig::new(|_| ());
    let mut printer = rig.printer();
    printer.set_equipment(Equipment { end_stops: false, ..Equipment::ALL });
    for line in ["G28", "G28 X", "G28 Z"] {
        assert_eq!(execute(&mut printer, line), refused(CommandError::NotEquipped("end stops")));
        assert_eq!((rig.take_events(), printer.interpreter.modal.homed, rig.enabled()), (vec![], [false; 3], 0));
    }
}

/// M410 in an approach: the axis's position is that of its motor, not homed, and the axes after
/// it are not tried.
#[test]
fn a_stop_on_the_way_leaves_the_axis_where_it_is() {
    for (seek, axis, expected_mm) in [(0, 0, -1.0), (1, 0, -56.0), (2, 1, -1.0), (5, 2, -36.0)] {
        let rig = Rig::new(|_| ());
        rig.stopped_seek.set(Some(seek));
        let mut printer = rig.printer();
        printer.interpreter.modal.homed = [true; 3];
        assert_eq!(execute(&mut printer, "G28"), refused(CommandError::Stopped), "seek {seek}");
        assert_eq!(printer.interpreter.modal.homed, core::array::from_fn(|one| one != axis), "seek {seek}");
        assert_eq!(rig.believed_mm()[axis], expected_mm, "seek {seek}");
        assert_eq!(printer.interpreter.modal.machine_10nm[axis], (expected_mm * MM as f64) as i64);
        let sought = rig.take_events().into_iter().filter(|event| matches!(event, Event::Sought(..))).count();
        assert_eq!(sought, seek + 1);
    }
}

#[test]
fn the_way_is_counted_in_the_direction_of_homing() {
    let to_max = AxisHoming { end: HomeEnd::Max, ..crate::motion::machine::tests::profile().homing[0] };
    let to_min = AxisHoming { end: HomeEnd::Min, ..to_max };
    assert_eq!([way_10nm(&to_max, 3, 5), way_10nm(&to_max, 5, 3)], [2, -2]);
    assert_eq!([way_10nm(&to_min, 3, 5), way_10nm(&to_min, 5, 3)], [-2, 2]);
}
