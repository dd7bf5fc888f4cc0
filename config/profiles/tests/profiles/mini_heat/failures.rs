//! Each failure of the MINI's heaters, in each state, and the time until it is noticed: on the
//! virtual board's model of it.

use ferrostep_hal_shim::Heater;
use ferrostep_printer::heat::safety::Trip;
use ferrostep_printer::heat::{HeatControl, HeatFault, SAMPLE_MS};
use ferrostep_profiles::load;
use ferrostep_virtual_board::{HeaterFailure, VirtualHeaters};

const SAMPLES_A_S: f32 = 1000.0 / SAMPLE_MS as f32;

/// Targets that users set, degrees Celsius: the lowest and the highest, and the commonest.
const TARGETS: [[f32; 3]; 2] = [[170.0, 215.0, 280.0], [40.0, 60.0, 100.0]];

/// Control and virtual board.
#[derive(Clone)]
struct Rig {
    control: HeatControl,
    board: VirtualHeaters,
}

impl Rig {
    fn new() -> Self {
        let profile = load("prusa-mini").unwrap();
        let mut board = profile.virtual_heaters();
        Self { control: HeatControl::new(profile.heaters(), profile.fans, &mut board), board }
    }

    fn run(&mut self, seconds: f32) -> Result<(), HeatFault> {
        (0..(seconds * SAMPLES_A_S) as u32).try_for_each(|_| {
            self.board.advance(1.0 / SAMPLES_A_S);
            self.control.update(&mut self.board)
        })
    }

    fn on_the_way(heater: Heater, target: f32) -> Self {
        let mut rig = Self::new();
        rig.control.set_target(heater, target);
        rig.run(12.0).unwrap();
        rig
    }

    fn holding(heater: Heater, target: f32) -> Self {
        let mut rig = Self::new();
        rig.control.set_target(heater, target);
        rig.run(1800.0).unwrap();
        assert!((rig.board.true_celsius(heater) - target).abs() < 1.0, "{heater:?} {target}");
        rig
    }

    fn cooling(heater: Heater, target: f32) -> Self {
        let mut rig = Self::holding(heater, target);
        rig.control.set_target(heater, 0.0);
        rig.run(3.0).unwrap();
        rig
    }

    /// Makes the heater fail. Returns the trip, the seconds until it, and the highest true
    /// temperature until then.
    fn fail(mut self, heater: Heater, failure: HeaterFailure, at_most_s: f32) -> Option<(Trip, f32, f32)> {
        self.board.set_failure(heater, Some(failure));
        let mut highest = 0.0_f32;
        for sample in 1..=(at_most_s * SAMPLES_A_S) as u32 {
            self.board.advance(1.0 / SAMPLES_A_S);
            let outcome = self.control.update(&mut self.board);
            highest = highest.max(self.board.true_celsius(heater));
            if let Err(fault) = outcome {
                assert_eq!(fault.heater, heater, "{failure:?}");
                return Some((fault.trip, sample as f32 / SAMPLES_A_S, highest));
            }
        }
        None
    }
}

/// Watch and runaway period, s.
fn periods_s(heater: Heater) -> (f32, f32) {
    let profile = load("prusa-mini").unwrap();
    let watch = if heater == Heater::Nozzle { profile.nozzle.watch } else { profile.bed.watch };
    (watch.watch_ms as f32 * 1e-3, watch.runaway_ms as f32 * 1e-3)
}

/// Time from a failure to the third reading that shows it, s.
const MEDIAN_S: f32 = 0.03;

/// Heat on its way when the heater fails: the time for which the temperature still rises, s.
const DEAD_S: f32 = 4.0;

/// The failure is noticed within this many seconds, for this reason.
#[track_caller]
fn assert_noticed(rig: Rig, heater: Heater, failure: HeaterFailure, within_s: f32, is_right: fn(&Trip) -> bool) -> f32 {
    let (trip, after_s, highest) = rig.fail(heater, failure, 3600.0).expect("never noticed");
    assert!(
        is_right(&trip) && after_s <= within_s,
        "{heater:?} {failure:?}: {trip:?} after {after_s} s, not {within_s} s"
    );
    highest
}

/// The heaters of a MINI.
const HEATERS: [Heater; 2] = [Heater::Nozzle, Heater::Bed];

#[test]
fn a_broken_thermistor_circuit_is_noticed_at_the_third_reading() {
    for heater in HEATERS {
        for target in TARGETS[heater.index()] {
            for rig in [
                Rig::new(),
                Rig::on_the_way(heater, target),
                Rig::holding(heater, target),
                Rig::cooling(heater, target),
            ] {
                for failure in [HeaterFailure::ThermistorOpen, HeaterFailure::ThermistorShorted] {
                    assert_noticed(rig.clone(), heater, failure, MEDIAN_S, |trip| matches!(trip, Trip::Sensor(_)));
                }
            }
        }
    }
}

#[test]
fn a_dead_heater_is_noticed() {
    // Below the hysteresis first, and then the period: the nozzle of 170 C takes 15 s for that, the
    // bed of 100 C 140 s.
    let cools_s = [16.0, 160.0];
    for heater in HEATERS {
        let (watch_s, runaway_s) = periods_s(heater);
        for target in TARGETS[heater.index()] {
            let failed = |trip: &Trip| matches!(trip, Trip::HeatingFailed(_));
            assert_noticed(Rig::on_the_way(heater, target), heater, HeaterFailure::Dead, watch_s + DEAD_S, failed);
            let within_s = runaway_s + cools_s[heater.index()];
            let runaway = |trip: &Trip| matches!(trip, Trip::Runaway(_));
            assert_noticed(Rig::holding(heater, target), heater, HeaterFailure::Dead, within_s, runaway);
        }
    }
}

/// The heater stays at full power meanwhile.
#[test]
fn a_thermistor_that_fell_out_is_noticed_before_anything_melts() {
    // The nozzle's aluminium and brass bear more than its PTFE; the bed cannot get
    // hotter than 110 C.
    let rises = [60.0, 45.0];
    for heater in HEATERS {
        let (watch_s, runaway_s) = periods_s(heater);
        for target in TARGETS[heater.index()] {
            let failure = HeaterFailure::ThermistorFellOut;
            let failed = |trip: &Trip| matches!(trip, Trip::HeatingFailed(_));
            let highest = assert_noticed(Rig::on_the_way(heater, target), heater, failure, watch_s, failed);
            assert!(highest < 130.0, "{heater:?} {target}: {highest}");
            let runaway = |trip: &Trip| matches!(trip, Trip::Runaway(_));
            let highest = assert_noticed(Rig::holding(heater, target), heater, failure, runaway_s + 2.0, runaway);
            assert!(highest < target + rises[heater.index()], "{heater:?} {target}: {highest}");
        }
    }
}

#[test]
fn a_reading_that_stands_still_is_noticed() {
    for heater in HEATERS {
        let (watch_s, runaway_s) = periods_s(heater);
        for target in TARGETS[heater.index()] {
            let failure = HeaterFailure::ThermistorFrozen;
            let failed = |trip: &Trip| matches!(trip, Trip::HeatingFailed(_));
            assert_noticed(Rig::on_the_way(heater, target), heater, failure, watch_s, failed);
            // A degree off its target: the power changes by 5 % in that time, and should
            // have been answered.
            let mut rig = Rig::holding(heater, target - 1.0);
            rig.board.set_failure(heater, Some(failure));
            rig.control.set_target(heater, target);
            let frozen = |trip: &Trip| matches!(trip, Trip::Frozen(_));
            let highest = assert_noticed(rig, heater, failure, runaway_s + 15.0, frozen);
            assert!(highest < target + 60.0, "{heater:?} {target}: {highest}");
        }
    }
}

#[test]
fn a_transistor_that_failed_closed_is_noticed_whatever_the_target() {
    for heater in HEATERS {
        let is_nozzle = heater == Heater::Nozzle;
        for target in TARGETS[heater.index()] {
            let hot_bed = !is_nozzle && target == 100.0;
            let rises =
                |trip: &Trip| matches!(trip, Trip::RisesUnpowered(_) | Trip::TooHot(_) | Trip::StaysHotUnpowered(_));
            // A quarter of the watch period, and ten degrees; a bed at 100 C cannot rise by them,
            // and does not cool either.
            for (rig, within_s) in [
                (Rig::new(), if is_nozzle { 10.0 } else { 120.0 }),
                (
                    Rig::holding(heater, target),
                    if is_nozzle {
                        15.0
                    } else if hot_bed {
                        720.0
                    } else {
                        180.0
                    },
                ),
                (
                    Rig::cooling(heater, target),
                    if is_nozzle {
                        10.0
                    } else if hot_bed {
                        600.0
                    } else {
                        180.0
                    },
                ),
            ] {
                let highest = assert_noticed(rig, heater, HeaterFailure::StuckOn, within_s, rises);
                assert!(highest < if is_nozzle { 296.0 } else { 110.0 }, "{heater:?} {target}: {highest}");
            }
            // On the way it is only too good, until the target.
            let mut rig = Rig::on_the_way(heater, target);
            rig.board.set_failure(heater, Some(HeaterFailure::StuckOn));
            while rig.board.true_celsius(heater) < target {
                rig.run(0.1).unwrap();
            }
            let within_s = if is_nozzle {
                25.0
            } else if hot_bed {
                720.0
            } else {
                240.0
            };
            assert_noticed(rig, heater, HeaterFailure::StuckOn, within_s, rises);
        }
    }
}
