//! A power supply that can be switched: the end of a heater whose transistor has failed closed.

use super::*;

/// A nozzle at its target whose transistor fails closed, until the fault is noticed: the rig, and
/// the temperature then.
fn closed_transistor(supply: Option<bool>) -> (Rig, f32) {
    let mut rig = Rig::holding(Heater::Nozzle);
    if let Some(on) = supply {
        rig.control.set_supply(on);
        rig.run(1.0).unwrap();
    }
    rig.control.set_target(Heater::Nozzle, 0.0);
    let (fault, _) = rig.fail(Heater::Nozzle, HeaterFailure::StuckOn).fault_after(600.0);
    assert_eq!(fault.heater, Heater::Nozzle);
    let celsius = rig.board.true_celsius(Heater::Nozzle);
    (rig, celsius)
}

#[test]
fn it_ends_what_no_heater_s_switch_can() {
    let (mut rig, noticed) = closed_transistor(Some(true));
    assert_eq!(rig.control.supply(), Some(false));
    assert!(!rig.board.has_supply(), "off in the very sample of the fault");
    rig.run(300.0).unwrap();
    let later = rig.board.true_celsius(Heater::Nozzle);
    assert!(later < 60.0, "{noticed} {later}");
    // A supply that fails as well leaves the fans to cool.
    assert_eq!(rig.board.fan_power(FanOutput::HotEnd), 255);
    // The same machine without such a supply keeps heating.
    let (mut rig, noticed) = closed_transistor(None);
    assert_eq!(rig.control.supply(), None);
    rig.run(300.0).unwrap();
    let later = rig.board.true_celsius(Heater::Nozzle);
    assert!(later > noticed + 20.0, "{noticed} {later}");
}

#[test]
fn a_fault_keeps_it_off_and_nothing_heats_without_it() {
    let (mut rig, _) = closed_transistor(Some(true));
    rig.control.set_supply(true);
    rig.run(1.0).unwrap();
    assert!(!rig.board.has_supply());
    let mut rig = Rig::new();
    rig.control.set_supply(true);
    rig.fail(Heater::Bed, HeaterFailure::ThermistorOpen).fault_after(1.0);
    rig.board.set_failure(Heater::Bed, None);
    rig.run(1.0).unwrap();
    rig.control.restart().unwrap();
    rig.run(1.0).unwrap();
    assert!(!rig.board.has_supply(), "M999 switches nothing on");
    rig.control.set_target(Heater::Nozzle, 100.0);
    rig.control.begin_relay(Heater::Bed, 60.0, 3, false);
    rig.run(1.0).unwrap();
    assert_eq!(Heater::ALL.map(|heater| rig.control.status(heater).target_celsius), [0.0; Heater::COUNT]);
    rig.control.set_supply(true);
    rig.control.set_target(Heater::Nozzle, 100.0);
    rig.run(1.0).unwrap();
    assert!(rig.board.has_supply() && rig.board.power(Heater::Nozzle) > 0.0);
    // M81, and a halt.
    rig.control.set_supply(false);
    rig.run(1.0).unwrap();
    assert!(!rig.board.has_supply() && rig.board.power(Heater::Nozzle) == 0.0);
    rig.control.set_supply(true);
    rig.control.halt();
    rig.run(1.0).unwrap();
    assert!(!rig.board.has_supply());
}

/// The speed of a fan without supply is not judged.
#[test]
fn a_fan_without_supply_has_not_failed() {
    let mut fans = FanSettings::USUAL;
    for fan in fans.iter_mut().flatten() {
        fan.least_rpm = 1000;
    }
    let stalled = [Some(true), Some(false)].map(|supply| {
        let mut rig = Rig::new();
        rig.control.fan_table = fans;
        rig.control.set_fan_demand(FanDemand::part(255));
        rig.run(10.0).unwrap();
        assert_eq!(rig.control.stalled_fan(), None);
        rig.control.supply = supply;
        rig.board.set_fan_stuck(FanOutput::Part, true);
        rig.run(10.0).unwrap();
        rig.control.stalled_fan()
    });
    assert_eq!(stalled, [Some(FanOutput::Part), None]);
}
