//! Each failure of a heater or thermistor on the virtual board, and when it is noticed.

use super::*;

/// Time from the failure to the third reading that shows it, s.
const MEDIAN_S: f32 = 0.03;

/// The watch period and the runaway period, s.
fn periods_s(heater: Heater) -> (f32, f32) {
    let watch = settings(heater).watch;
    (watch.watch_ms as f32 * 1e-3, watch.runaway_ms as f32 * 1e-3)
}

/// A rig on the way to the usual target.
fn heating(heater: Heater) -> Rig {
    let mut rig = Rig::new();
    rig.control.set_target(heater, usual_target(heater));
    rig.run(15.0).unwrap();
    rig
}

/// A rig in every state that it can be in for long: off, heating up, holding, cooling.
fn states(heater: Heater) -> [Rig; 4] {
    let mut cooling = Rig::holding(heater);
    cooling.control.set_target(heater, 0.0);
    cooling.run(5.0).unwrap();
    [Rig::new(), heating(heater), Rig::holding(heater), cooling]
}

#[test]
fn nothing_trips_while_nothing_fails() {
    for heater in ALONE {
        let mut rig = Rig::holding(heater);
        for target in [usual_target(heater) + 20.0, 40.0, usual_target(heater), 0.0, 25.0, usual_target(heater)] {
            rig.control.set_target(heater, target);
            rig.run(150.0).unwrap();
            rig.control.set_fan_demand(FanDemand::part(255));
            rig.run(150.0).unwrap();
            rig.control.set_fan_demand(FanDemand::part(0));
        }
    }
}

/// A step after a reading that has long been the same: six hours in this run's share of the cases,
/// ten minutes in the others.
#[test]
fn a_step_after_hours_of_holding_trips_nothing() {
    let steps = [1.0, -1.0, 0.5, -0.5];
    let long: std::vec::Vec<u64> = ferrostep_random_cases::share_of((ALONE.len() * steps.len()) as u64).collect();
    let cases = ALONE.iter().flat_map(|heater| steps.map(|step| (*heater, step)));
    for (case, (heater, step)) in (0..).zip(cases) {
        let mut rig = Rig::holding(heater);
        rig.run(if long.contains(&case) { 21_600.0 } else { 600.0 }).unwrap();
        rig.control.set_target(heater, usual_target(heater) + step);
        rig.run(150.0).unwrap();
    }
}

#[test]
fn an_open_or_shorted_thermistor_is_noticed_at_the_third_reading() {
    for heater in ALONE {
        for (failure, error) in [
            (HeaterFailure::ThermistorOpen, ferrostep_hal_shim::SensorError::Open),
            (HeaterFailure::ThermistorShorted, ferrostep_hal_shim::SensorError::Shorted),
        ] {
            for mut rig in states(heater) {
                let (fault, after_s) = rig.fail(heater, failure).fault_after(1.0);
                assert_eq!(fault, HeatFault { heater, trip: Trip::Sensor(error) });
                assert_eq!(after_s, MEDIAN_S);
            }
        }
    }
}

#[test]
fn a_dead_heater_is_noticed_within_the_watch_period_while_heating_up() {
    for heater in ALONE {
        let (watch_s, _) = periods_s(heater);
        // From cold: at the end of the period exactly.
        let mut rig = Rig::new();
        rig.control.set_target(heater, usual_target(heater));
        let (fault, after_s) = rig.fail(heater, HeaterFailure::Dead).fault_after(300.0);
        assert!(matches!(fault.trip, Trip::HeatingFailed(_)) && fault.heater == heater, "{fault}");
        assert!((after_s - watch_s).abs() < 0.02, "{after_s} s");
        // On the way: no later.
        let (fault, after_s) = heating(heater).fail(heater, HeaterFailure::Dead).fault_after(300.0);
        assert!(matches!(fault.trip, Trip::HeatingFailed(_)), "{fault}");
        assert!(after_s <= watch_s + 0.02, "{after_s} s");
    }
}

/// A host that repeats M104, the same or another, must not put the watch to sleep.
#[test]
fn the_watch_outlasts_new_targets() {
    for heater in ALONE {
        let mut rig = Rig::new();
        rig.fail(heater, HeaterFailure::Dead);
        let mut samples = 0;
        let fault = loop {
            rig.control.set_target(heater, usual_target(heater) + f32::from(samples % 3 == 0));
            samples += 1;
            assert!(samples < 300 * SAMPLES_A_S, "{heater:?} has never failed");
            if let Err(fault) = rig.sample() {
                break fault;
            }
        };
        assert!(matches!(fault.trip, Trip::HeatingFailed(_)), "{fault}");
        assert!(samples as f32 / SAMPLES_A_S as f32 <= periods_s(heater).0 + 0.02);
    }
}

#[test]
fn a_dead_heater_is_noticed_at_the_target() {
    for heater in ALONE {
        let (_, runaway_s) = periods_s(heater);
        let hysteresis = settings(heater).watch.runaway_celsius;
        let mut rig = Rig::holding(heater);
        rig.fail(heater, HeaterFailure::Dead);
        let mut cooling_s = 0.0;
        while rig.board.true_celsius(heater) >= usual_target(heater) - hysteresis {
            rig.sample().unwrap();
            cooling_s += SAMPLE_MS as f32 * 1e-3;
        }
        let (fault, after_s) = rig.fault_after(300.0);
        assert!(matches!(fault.trip, Trip::Runaway(_)) && fault.heater == heater, "{fault}");
        assert!((after_s - runaway_s).abs() < 0.1, "{after_s} s after {cooling_s} s");
    }
}

/// The heater stays at full power meanwhile: the temperature that it reaches must do no harm.
#[test]
fn a_thermistor_that_fell_out_is_noticed_before_the_heater_is_too_hot() {
    for heater in ALONE {
        let (watch_s, runaway_s) = periods_s(heater);
        let mut rig = heating(heater);
        let (fault, after_s) = rig.fail(heater, HeaterFailure::ThermistorFellOut).fault_after(300.0);
        assert!(matches!(fault.trip, Trip::HeatingFailed(_)), "{fault}");
        assert!(after_s <= watch_s + 0.02, "{after_s} s");
        assert!(rig.board.true_celsius(heater) < settings(heater).max_celsius);

        let mut rig = Rig::holding(heater);
        let (fault, after_s) = rig.fail(heater, HeaterFailure::ThermistorFellOut).fault_after(300.0);
        assert!(matches!(fault.trip, Trip::Runaway(_)), "{fault}");
        assert!(after_s <= runaway_s + 0.5, "{after_s} s");
        // The default allows the nozzle 40 s at full power.
        let reached = rig.board.true_celsius(heater);
        assert!(reached < settings(heater).max_celsius + 25.0, "{reached}");
    }
}

#[test]
fn a_transistor_that_failed_closed_is_noticed_whatever_the_target() {
    for heater in ALONE {
        for mut rig in states(heater) {
            rig.fail(heater, HeaterFailure::StuckOn);
            // On its way to a target, it is only too good.
            while rig.board.true_celsius(heater) < rig.control.status(heater).target_celsius {
                rig.sample().unwrap();
            }
            let (fault, after_s) = rig.fault_after(600.0);
            assert!(matches!(fault.trip, Trip::RisesUnpowered(_)), "{fault}");
            assert!(after_s <= periods_s(heater).0, "{fault} after {after_s} s");
            assert!(rig.board.true_celsius(heater) < settings(heater).max_celsius);
        }
    }
}

#[test]
fn the_maximum_trips_before_the_slower_checks() {
    for heater in ALONE {
        let mut rig = Rig::new();
        rig.control.set_target(heater, settings(heater).max_celsius - 0.5);
        rig.run(60.0).unwrap();
        let (fault, _) = rig.fail(heater, HeaterFailure::StuckOn).fault_after(900.0);
        let Trip::TooHot(celsius) = fault.trip else { panic!("{fault}") };
        assert!((0.0..0.3).contains(&(celsius - settings(heater).max_celsius)), "{celsius}");
    }
}

#[test]
fn a_reading_that_stands_still_is_noticed() {
    for heater in ALONE {
        let (watch_s, runaway_s) = periods_s(heater);
        let (fault, after_s) = heating(heater).fail(heater, HeaterFailure::ThermistorFrozen).fault_after(300.0);
        assert!(matches!(fault.trip, Trip::HeatingFailed(_)), "{fault}");
        assert!(after_s <= watch_s + 0.02, "{after_s} s");

        // At the target, with the reading a little below it, the loop would give
        // more and more power.
        let mut rig = Rig::holding(heater);
        let target = usual_target(heater) + 1.0;
        rig.fail(heater, HeaterFailure::ThermistorFrozen).control.set_target(heater, target);
        let (fault, after_s) = rig.fault_after(300.0);
        assert!(matches!(fault.trip, Trip::Frozen(_)), "{fault}");
        assert!((after_s - runaway_s).abs() < 0.1, "{after_s} s");
        let reached = rig.board.true_celsius(heater);
        assert!(reached < target + 30.0, "{reached}");
    }
}

/// A spark on the wire: one or two bad readings, again and again.
#[test]
fn bad_readings_between_good_ones_change_nothing() {
    struct Sparks {
        board: VirtualHeaters,
        readings: usize,
        bad: [u16; 2],
    }
    impl ThermalBoard for Sparks {
        fn reading(&mut self, heater: Heater) -> u16 {
            self.readings += 1;
            // Each heater is read once a sample: of five samples, two are bad.
            match self.readings / Heater::COUNT % 5 {
                index @ 0..2 => self.bad[index],
                _ => self.board.reading(heater),
            }
        }
        fn set_power(&mut self, heater: Heater, power: f32) {
            self.board.set_power(heater, power);
        }
    }
    impl Fans for Sparks {
        fn set_fan_power(&mut self, _: FanOutput, _: u8) {}
    }
    for bad in [[0, 0], [u16::MAX, u16::MAX], [0, u16::MAX], [1, 65_000]] {
        let Rig { control, board, .. } = Rig::new();
        let (mut control, mut board) = (control, Sparks { board, readings: 0, bad });
        for heater in ALONE {
            control.set_target(heater, usual_target(heater));
        }
        for _ in 0..240 * SAMPLES_A_S {
            board.board.advance(SAMPLE_MS as f32 * 1e-3);
            control.update(&mut board).unwrap();
        }
        for heater in ALONE {
            assert!((board.board.true_celsius(heater) - usual_target(heater)).abs() < 0.5);
        }
    }
}

#[test]
fn m999_ends_a_fault_that_is_over_and_no_other() {
    for heater in ALONE {
        let mut rig = Rig::holding(heater);
        let (fault, _) = rig.fail(heater, HeaterFailure::ThermistorOpen).fault_after(1.0);
        assert_eq!(rig.control.restart(), Err(fault));
        assert_eq!(rig.control.fault(), Some(fault));
        rig.control.set_target(heater, 50.0);
        assert!(rig.sample().is_ok(), "reported once");
        assert_eq!(rig.board.power(heater), 0.0);

        rig.board.set_failure(heater, None);
        rig.run(0.1).unwrap();
        assert_eq!(rig.control.restart(), Ok(()));
        rig.run(1.0).unwrap();
        assert_eq!(rig.board.power(heater), 0.0, "M999 switches nothing on");
        rig.control.set_target(heater, usual_target(heater));
        rig.run(120.0).unwrap();
        assert!((rig.board.true_celsius(heater) - usual_target(heater)).abs() < 3.0);

        // Too hot, until it has cooled.
        let mut rig = Rig::new();
        rig.control.set_target(heater, settings(heater).max_celsius - 0.5);
        rig.run(60.0).unwrap();
        let (fault, _) = rig.fail(heater, HeaterFailure::StuckOn).fault_after(900.0);
        assert!(matches!(fault.trip, Trip::TooHot(_)), "{fault}");
        assert!(rig.control.restart().is_err());
        rig.board.set_failure(heater, None);
        rig.run(30.0).unwrap();
        assert_eq!(rig.control.restart(), Ok(()));
    }
}

/// The heater, its transistor or the thermistor's place: a reading within its limits does not show
/// that they are sound.
#[test]
fn m999_ends_no_fault_of_a_heater() {
    for heater in ALONE {
        let frozen = || {
            let mut rig = Rig::holding(heater);
            rig.control.set_target(heater, usual_target(heater) + 1.0);
            rig
        };
        for (failure, mut rig) in [
            (HeaterFailure::Dead, heating(heater)),
            (HeaterFailure::ThermistorFellOut, heating(heater)),
            (HeaterFailure::Dead, Rig::holding(heater)),
            (HeaterFailure::StuckOn, Rig::holding(heater)),
            (HeaterFailure::ThermistorFrozen, frozen()),
        ] {
            let (fault, _) = rig.fail(heater, failure).fault_after(600.0);
            // Mended or not.
            for failure in [Some(failure), None] {
                rig.board.set_failure(heater, failure);
                for _ in 0..3 {
                    assert_eq!(rig.control.restart(), Err(fault), "{failure:?}");
                    rig.control.set_target(heater, usual_target(heater));
                    rig.run(60.0).unwrap();
                    assert_eq!((rig.control.fault(), rig.board.power(heater)), (Some(fault), 0.0));
                }
            }
        }
    }
}

/// The fans as the board has them: the part's power, and whether the hot end's turns.
fn of_board(board: &VirtualHeaters) -> (u8, bool) {
    let hot_end = board.fan_power(FanOutput::HotEnd);
    assert!([0, 255].contains(&hot_end));
    (board.fan_power(FanOutput::Part), hot_end > 0)
}

fn fans(rig: &Rig) -> (u8, bool) {
    of_board(&rig.board)
}

/// All fans blow after a fault: with a transistor that has failed closed only moving air is left.
#[test]
fn every_fault_puts_all_fans_to_full_until_it_is_cleared() {
    for heater in USUAL {
        for failure in [
            HeaterFailure::Dead,
            HeaterFailure::StuckOn,
            HeaterFailure::ThermistorOpen,
            HeaterFailure::ThermistorShorted,
            HeaterFailure::ThermistorFellOut,
            HeaterFailure::ThermistorFrozen,
        ] {
            let mut rig = Rig::holding(heater);
            rig.control.set_fan_demand(FanDemand::part(51));
            rig.sample().unwrap();
            assert_eq!(fans(&rig), (51, heater == Heater::Nozzle));
            rig.control.set_target(heater, usual_target(heater) + 1.0);
            rig.fail(heater, failure).fault_after(600.0);
            assert_eq!(fans(&rig), (255, true), "{heater:?} {failure:?}: in the sample of the fault");
            // Whatever M107 says, and whatever the temperature.
            rig.control.set_fan_demand(FanDemand::part(0));
            rig.run(600.0).unwrap();
            assert_eq!(fans(&rig), (255, true), "{heater:?} {failure:?}");
            rig.board.set_failure(heater, None);
            rig.run(600.0).unwrap();
            let cleared = rig.control.restart().is_ok();
            rig.sample().unwrap();
            assert_eq!(fans(&rig), if cleared { (0, false) } else { (255, true) }, "{heater:?} {failure:?}");
        }
    }
}

/// The fans turn after a reset at 250 degrees with a broken thermistor: an unknown temperature does
/// not mean a cold nozzle.
#[test]
fn the_fans_turn_while_the_nozzle_s_temperature_is_unknown() {
    let (_, mut board) = control_of(USUAL.map(settings), [None; 2], FanSettings::USUAL);
    board.set_failure(Heater::Nozzle, Some(HeaterFailure::ThermistorOpen));
    let [nozzle, bed] = USUAL.map(settings);
    let mut control: HeatControl =
        HeatControl::new([Some(nozzle), Some(bed), None, None], FanSettings::USUAL, &mut board);
    assert!(of_board(&board).1, "before the first sample");
    assert!(control.update(&mut board).is_err());
    assert_eq!(of_board(&board), (255, true));
    assert_eq!(control.status(Heater::Nozzle).celsius, 0.0, "too cold to extrude");
    // The plug goes back in: M999, and the first reading says that the nozzle is cold.
    board.set_failure(Heater::Nozzle, None);
    (0..5).for_each(|_| assert!(control.update(&mut board).is_ok()));
    assert_eq!(control.restart(), Ok(()));
    assert!(control.update(&mut board).is_ok());
    assert_eq!(of_board(&board), (0, false));
    // A sound machine: on at the start, off with the first reading.
    let mut rig = Rig::new();
    assert_eq!(fans(&rig), (0, true));
    rig.sample().unwrap();
    assert_eq!(fans(&rig), (0, false));
}
