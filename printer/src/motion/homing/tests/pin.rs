//! A probe with a pin: its commands in order, and the effects of a signal that is wrong
//! once or permanently.

use super::*;
use crate::settings::profile::homing::{BlTouch, SafeHoming};

const IN: u16 = 1_475;
const OUT: u16 = 650;
const TOUCH_MODE: u16 = 1_165;
const RELEASE: u16 = 2_190;

const PIN: BlTouch = BlTouch { move_ms: 680, stows_each_touch: true, tests_signal: true };

fn rig_with(pin: BlTouch) -> Rig {
    Rig::new(|profile| {
        profile.homing[2].sensor = HomeSensor::Probe;
        profile.bltouch = Some(pin);
        profile.safe_homing = SafeHoming {
            raise_10nm: 10 * MM,
            home_at_10nm: Some([100 * MM; 2]),
            probe_offset_10nm: [0, 0, -2 * MM],
            bed_10nm: [[0, 200 * MM]; 2],
            is_round: false,
        };
    })
}

fn seeks_of_z(rig: &Rig) -> usize {
    rig.take_events().iter().filter(|event| matches!(event, Event::Sought(2, ..))).count()
}

#[test]
fn the_pin_is_in_while_x_and_y_move_and_out_only_for_a_touch() {
    let touch = [TOUCH_MODE, OUT, IN];
    for (pin, of_z) in [
        (PIN, [touch, touch].concat()),
        (BlTouch { stows_each_touch: false, ..PIN }, touch.to_vec()),
        (BlTouch { tests_signal: false, ..PIN }, vec![OUT, IN, OUT, IN]),
    ] {
        let rig = rig_with(pin);
        let mut printer = rig.printer();
        execute(&mut printer, "G28 X Y").unwrap();
        assert_eq!(rig.take_told(), [IN]);
        execute(&mut printer, "G28").unwrap();
        assert_eq!(rig.take_told(), of_z, "{pin:?}: it is known to be in");
        execute(&mut printer, "M401").unwrap();
        let first = if pin.tests_signal { vec![IN, TOUCH_MODE, OUT] } else { vec![IN, OUT] };
        assert_eq!(rig.take_told(), first);
        execute(&mut printer, "G28 X").unwrap();
        assert_eq!(rig.take_told(), [IN]);
    }
}

/// The pin is released and commanded again after one wrong signal. After two the command fails, Z
/// has not gone down, and the pin is called in.
#[test]
fn a_wrong_signal_is_tried_again_once() {
    for (wrong, again) in [
        (IN, vec![IN, RELEASE, IN]),
        (TOUCH_MODE, vec![IN, TOUCH_MODE, RELEASE, IN, TOUCH_MODE, OUT]),
        (OUT, vec![IN, TOUCH_MODE, OUT, RELEASE, IN, TOUCH_MODE, OUT]),
    ] {
        let rig = rig_with(PIN);
        let mut printer = rig.printer();
        rig.wrong_signals.set((wrong, 1));
        execute(&mut printer, "G28").unwrap();
        assert!(rig.take_told().starts_with(&again), "{wrong}");
        assert_eq!(seeks_of_z(&rig), 2);
        rig.wrong_signals.set((wrong, u32::MAX));
        execute(&mut printer, "M280 P0 S90").unwrap();
        rig.take_events();
        let outcome = execute(&mut printer, "G28");
        assert!(matches!(outcome, Err(Failure::Command(CommandError::ProbePin(_)))), "{wrong}: {outcome:?}");
        assert_eq!((seeks_of_z(&rig), rig.take_told().last().copied()), (0, Some(IN)), "{wrong}");
        assert_eq!(printer.interpreter.modal.z.pin_is_in, wrong != IN, "{wrong}");
    }
}

#[test]
fn a_stop_on_the_way_down_calls_it_in() {
    let rig = rig_with(PIN);
    let mut printer = rig.printer();
    execute(&mut printer, "G28 X Y").unwrap();
    rig.take_told();
    rig.take_events();
    rig.stopped_seek.set(Some(0));
    assert_eq!(execute(&mut printer, "G28 Z"), refused(CommandError::Stopped));
    assert_eq!(rig.take_told(), [TOUCH_MODE, OUT, IN]);
}
