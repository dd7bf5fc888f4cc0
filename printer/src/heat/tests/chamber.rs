//! A chamber: heated by its own heater, by the bed, or by both.

use super::tuning::Noisy;
use super::*;

/// The reason of a fault.
fn trip(outcome: Result<(), HeatFault>) -> Option<Trip> {
    outcome.err().map(|fault| {
        assert_eq!(fault.heater, Heater::Chamber);
        fault.trip
    })
}

/// A machine whose chamber has a thermometer and no heater.
fn with_a_thermometer() -> Rig {
    let settings_of_chamber = HeaterSettings { is_heated: false, ..settings(Heater::Chamber) };
    let (control, board) = control_of(USUAL.map(settings), [Some(settings_of_chamber), None], FanSettings::USUAL);
    Rig { control, board, samples: 0 }
}

#[test]
fn a_chamber_reaches_its_target_and_stays() {
    let mut rig = Rig::new();
    rig.control.set_target(Heater::Bed, 60.0);
    rig.control.set_target(Heater::Chamber, 50.0);
    rig.run(1_800.0).unwrap();
    for _ in 0..3_600 {
        rig.run(1.0).unwrap();
        let celsius = rig.control.status(Heater::Chamber).celsius;
        assert!((celsius - 50.0).abs() < settings(Heater::Chamber).residency_window_celsius, "{celsius}");
    }
    assert_eq!(rig.control.chamber_is_heated(), Some(true));
}

/// A bed warms the chamber to 33 degrees above the room without any power of the chamber's heater:
/// in a nozzle that means a failed transistor.
#[test]
fn a_bed_may_warm_the_chamber_and_keep_it_warm() {
    for mut rig in [Rig::new(), with_a_thermometer()] {
        rig.control.set_target(Heater::Bed, 110.0);
        rig.run(3.0 * 3_600.0).unwrap();
        assert!(rig.board.true_celsius(Heater::Chamber) > 55.0);
        assert_eq!(rig.board.power(Heater::Chamber), 0.0);
    }
}

#[test]
fn a_thermometer_alone_takes_a_target_and_never_power() {
    let mut rig = with_a_thermometer();
    rig.control.set_target(Heater::Chamber, 50.0);
    rig.run(3_600.0).unwrap();
    let HeaterStatus { celsius, target_celsius, power } = rig.control.status(Heater::Chamber);
    assert!((celsius - 22.0).abs() < 1.0);
    assert_eq!((target_celsius, power), (50.0, 0.0));
    assert_eq!(rig.control.chamber_is_heated(), Some(false));
    // Its reading is watched all the same.
    rig.fail(Heater::Chamber, HeaterFailure::ThermistorShorted);
    assert_eq!(trip(rig.run(1.0)), Some(Trip::Sensor(ferrostep_hal_shim::SensorError::Shorted)));
}

#[test]
fn a_dead_heater_and_a_thermistor_that_fell_out_are_noticed() {
    let watch = HeaterWatch::CHAMBER;
    let period_s = watch.watch_ms as f32 * 1e-3;
    for failure in [HeaterFailure::Dead, HeaterFailure::ThermistorFellOut, HeaterFailure::ThermistorFrozen] {
        let mut rig = Rig::new();
        rig.fail(Heater::Chamber, failure).control.set_target(Heater::Chamber, 50.0);
        let (fault, after_s) = rig.fault_after(2.0 * period_s);
        assert!(matches!(fault.trip, Trip::HeatingFailed(_)), "{failure:?}: {fault}");
        assert!((after_s - period_s).abs() < 1.0, "{failure:?}: {after_s}");
        assert!(fault.to_string().starts_with("Error:Heating failed, system stopped! Heater_ID: chamber"), "{fault}");
    }
    // At its target. A reading that stays the same there, while the power does so as well, is
    // noticed at the next target.
    for failure in [HeaterFailure::Dead, HeaterFailure::ThermistorFellOut] {
        let mut rig = Rig::new();
        rig.control.set_target(Heater::Chamber, 50.0);
        rig.run(3_600.0).unwrap();
        rig.fail(Heater::Chamber, failure);
        let (fault, _) = rig.fault_after(3_600.0);
        let celsius = rig.board.true_celsius(Heater::Chamber);
        assert!(matches!(fault.trip, Trip::Runaway(_)) && celsius < 70.0, "{failure:?}: {fault}, {celsius}");
    }
}

/// A transistor that has failed closed looks like a bed that warms the chamber, up to the maximum.
#[test]
fn a_heater_that_stays_on_ends_at_the_maximum() {
    let mut rig = Rig::new();
    rig.fail(Heater::Chamber, HeaterFailure::StuckOn);
    rig.control.set_target(Heater::Bed, 100.0);
    let (fault, _) = rig.fault_after(8.0 * 3_600.0);
    assert_eq!(fault.heater, Heater::Chamber);
    assert!(matches!(fault.trip, Trip::TooHot(celsius) if celsius < 90.5), "{fault}");
}

/// The air that comes in is cold; the parts that it cools are warm again within minutes.
#[test]
fn a_door_may_be_opened_for_a_moment_and_not_for_good() {
    for (open_s, is_noticed) in [(120.0, false), (900.0, true)] {
        let mut rig = Rig::new();
        rig.control.set_target(Heater::Chamber, 60.0);
        rig.run(3_600.0).unwrap();
        // The thermistor in the draught reads the room.
        rig.fail(Heater::Chamber, HeaterFailure::ThermistorFellOut);
        let outcome = rig.run(open_s);
        assert_eq!(outcome.is_err(), is_noticed, "{open_s} s");
        if outcome.is_ok() {
            rig.board.set_failure(Heater::Chamber, None);
            rig.run(3_600.0).unwrap();
        }
    }
}

#[test]
fn a_machine_without_a_chamber_has_none() {
    let (mut control, mut board) = control_of(USUAL.map(settings), [None; 2], FanSettings::USUAL);
    control.set_target(Heater::Chamber, 50.0);
    control.begin_relay(Heater::Chamber, 50.0, 3, false);
    assert_eq!(control.update(&mut board), Ok(()));
    assert_eq!(control.status(Heater::Chamber), HeaterStatus::default());
    assert_eq!((control.chamber_is_heated(), control.relay(Heater::Chamber)), (None, None));
}

/// Chambers with a heater: estimates of the air with the walls that it warms, the way of the air to
/// the thermistor as a dead time, and the thermistor's lag in air.
const CHAMBERS: [(f32, f32, f32, f32, f32); 3] = [
    // Power in W, J/K, W/K, dead time and lag in s: a desktop printer, one with a weak
    // heater, one of 400 mm.
    (200.0, 4_000.0, 4.0, 10.0, 20.0),
    (100.0, 3_000.0, 2.0, 15.0, 30.0),
    (500.0, 12_000.0, 9.0, 20.0, 40.0),
];

/// A chamber with a noisy converter, as every real one is: a reading without noise stays the same
/// where the temperature does.
struct Chamber {
    control: HeatControl,
    board: Noisy,
    seconds: u32,
}

impl Chamber {
    fn new((heater_w, capacity_j_per_k, loss_w_per_k, dead_time_s, sensor_lag_s): (f32, f32, f32, f32, f32)) -> Self {
        let mass =
            HeatedMass { heater_w, capacity_j_per_k, loss_w_per_k, fan_loss_w_per_k: 0.0, dead_time_s, sensor_lag_s };
        let chamber = HeaterSettings { mass, ..settings(Heater::Chamber) };
        let (control, board) = control_of(USUAL.map(settings), [Some(chamber), None], FanSettings::USUAL);
        Self { control, board: Noisy::new(board, 1.0), seconds: 0 }
    }

    fn second(&mut self) -> Result<(), HeatFault> {
        self.seconds += 1;
        (0..SAMPLES_A_S).try_for_each(|_| {
            self.board.board.advance(SAMPLE_MS as f32 * 1e-3);
            self.control.update(&mut self.board)
        })
    }

    /// Temperature that the thermistor would read without noise, degrees Celsius.
    fn celsius(&self) -> f32 {
        self.board.board.thermistor_celsius(Heater::Chamber)
    }

    /// The gains that M303 finds at a target.
    fn tuned(&mut self, celsius: f32) -> PidGains {
        self.control.begin_relay(Heater::Chamber, celsius, 5, false);
        loop {
            self.second().unwrap();
            match self.control.relay(Heater::Chamber) {
                Some(RelayProgress::Cycles { .. }) => {}
                Some(RelayProgress::Found(findings)) => return gains_by_relay(&findings, celsius),
                other => panic!("{other:?} after {} s", self.seconds),
            }
        }
    }
}

/// Tuned gains hold the chamber, whether the bed warms it meanwhile or not.
#[test]
fn tuned_gains_hold_a_chamber_within_half_a_degree() {
    for model in CHAMBERS {
        for bed_celsius in [0.0, 35.0] {
            let mut chamber = Chamber::new(model);
            chamber.control.set_target(Heater::Bed, bed_celsius);
            let gains = chamber.tuned(50.0);
            assert!(chamber.seconds < 2 * 3_600, "{model:?}: {} s", chamber.seconds);
            for target in [45.0, 50.0, 55.0] {
                let mut chamber = Chamber::new(model);
                chamber.control.set_gains(Heater::Chamber, gains);
                chamber.control.set_target(Heater::Bed, bed_celsius);
                chamber.control.set_target(Heater::Chamber, target);
                let mut highest = 0.0_f32;
                for second in 0..4_800 {
                    chamber.second().unwrap();
                    let celsius = chamber.celsius();
                    highest = highest.max(celsius);
                    let is_held = second < 3_600 || (celsius - target).abs() < 0.5;
                    assert!(is_held, "{model:?} {bed_celsius} {gains:?}: {celsius} of {target}");
                }
                assert!(highest < target + 1.0, "{model:?} {bed_celsius} {gains:?}: {highest} of {target}");
            }
        }
    }
}

/// A chamber that is heated for most of an hour does not count as failed, as a bed would.
#[test]
fn a_slow_chamber_is_tuned_too() {
    let mut chamber = Chamber::new((150.0, 8_000.0, 2.4, 20.0, 40.0));
    chamber.tuned(60.0);
    assert!(chamber.seconds > 50 * 60, "{} s", chamber.seconds);
}

/// But for a transistor that has failed closed, which only the maximum tells from a bed that warms.
#[test]
fn what_fails_while_a_chamber_is_tuned_is_noticed() {
    use HeaterFailure::*;
    for failure in [Dead, ThermistorFellOut, ThermistorOpen, ThermistorShorted, ThermistorFrozen] {
        for after_s in [60, 2_400] {
            let mut chamber = Chamber::new(CHAMBERS[0]);
            chamber.control.begin_relay(Heater::Chamber, 50.0, 20, false);
            (0..after_s).for_each(|_| chamber.second().unwrap());
            chamber.board.board.set_failure(Heater::Chamber, Some(failure));
            if failure == ThermistorFrozen {
                chamber.board.deviation = 0.0;
            }
            let fault = (0..3_600).find_map(|_| chamber.second().err());
            let fault = fault.unwrap_or_else(|| panic!("{failure:?} after {after_s} s"));
            assert_eq!(fault.heater, Heater::Chamber, "{failure:?}");
            let celsius = chamber.board.board.true_celsius(Heater::Chamber);
            assert!(celsius < 70.0, "{failure:?} after {after_s} s: {fault}, {celsius}");
        }
    }
}
