//! Each check of [`Safety`] at its very bounds, sample by sample.

use ferrostep_hal_shim::SensorError;

use super::*;
use crate::heat::safety::Safety;

/// Round numbers: 20 s for 2 degrees, 40 s below by more than 4.
const WATCH_SAMPLES: u32 = 20 * SAMPLES_A_S;
const RUNAWAY_SAMPLES: u32 = 40 * SAMPLES_A_S;

const TARGET: f32 = 200.0;

/// The checks of a nozzle whose sensor's readings a test chooses.
struct Checked {
    settings: HeaterSettings,
    safety: Safety,
    target: f32,
    power: f32,
}

impl Checked {
    fn new() -> Self {
        let settings = settings(Heater::Nozzle);
        assert_eq!(settings.watch, HeaterWatch::NOZZLE);
        Self { settings, safety: Safety::new(), target: 0.0, power: 0.0 }
    }

    /// A heater at its target.
    fn holding() -> Self {
        let mut checked = Self { target: TARGET, power: 0.3, ..Self::new() };
        checked.sample(TARGET).unwrap();
        checked
    }

    fn sample(&mut self, celsius: f32) -> Result<(), Trip> {
        self.safety.check(&self.settings, Ok(celsius), self.target, self.power, false)
    }

    /// Takes `count` samples, each a little different so that the reading always changes. A trip
    /// comes with the number of samples before it.
    fn samples(&mut self, count: u32, celsius: f32) -> Result<(), (u32, Trip)> {
        (0..count).try_for_each(|index| {
            let ripple = if index % 2 == 0 { 0.0 } else { 0.01 };
            self.sample(celsius + ripple).map_err(|trip| (index, trip))
        })
    }
}

#[test]
fn the_range_ends_at_its_bounds() {
    let HeaterSettings { min_celsius, max_celsius, .. } = settings(Heater::Nozzle);
    let mut checked = Checked::new();
    assert_eq!(checked.sample(min_celsius), Ok(()));
    assert_eq!(checked.sample(min_celsius - 0.01), Err(Trip::TooCold(min_celsius - 0.01)));
    assert!(matches!(checked.sample(f32::NAN), Err(Trip::TooCold(celsius)) if celsius.is_nan()));
    let mut checked = Checked::new();
    assert_eq!(checked.sample(max_celsius - 0.01), Ok(()));
    assert_eq!(checked.sample(max_celsius), Err(Trip::TooHot(max_celsius)));
    let outcome = checked.safety.check(&checked.settings, Err(SensorError::Open), 0.0, 0.0, false);
    assert_eq!(outcome, Err(Trip::Sensor(SensorError::Open)));
}

#[test]
fn heating_up_has_the_watch_period_for_each_two_degrees() {
    let mut checked = Checked { target: TARGET, power: 1.0, ..Checked::new() };
    let mut celsius = 22.0;
    checked.sample(celsius).unwrap();
    for _ in 0..3 {
        // A hair less than two degrees, to the last sample but one: then they are there.
        checked.samples(WATCH_SAMPLES - 2, celsius + 1.98).unwrap();
        celsius += 2.0;
        checked.sample(celsius).unwrap();
    }
    let (after, trip) = checked.samples(2 * WATCH_SAMPLES, celsius + 1.98).unwrap_err();
    assert!(matches!(trip, Trip::HeatingFailed(_)), "{trip:?}");
    assert_eq!(after, WATCH_SAMPLES - 1);
}

/// Switched off and on again, a nozzle keeps cooling until the heat has come through: two degrees
/// from its lowest count.
#[test]
fn heat_on_its_way_may_come_late() {
    let cooled = || {
        let mut checked = Checked { target: TARGET, power: 1.0, ..Checked::new() };
        checked.sample(150.0).unwrap();
        (1..=500).try_for_each(|sample| checked.sample(150.0 - sample as f32 * 0.02)).unwrap();
        checked
    };
    let mut checked = cooled();
    checked.samples(WATCH_SAMPLES - 502, 141.98).unwrap();
    checked.sample(142.0).unwrap();
    // The time has not begun anew with the lowest: a heater that only cools gets no more.
    let (after, trip) = cooled().samples(2 * WATCH_SAMPLES, 141.98).unwrap_err();
    assert!(matches!(trip, Trip::HeatingFailed(_)), "{trip:?}");
    assert_eq!(after, WATCH_SAMPLES - 502);
}

/// A target that is nearly there already is held, not heated up to, from below as from above.
#[test]
fn a_new_target_within_the_hysteresis_is_held() {
    let mut checked = Checked { target: 100.0, power: 1.0, ..Checked::new() };
    let (after, trip) = checked.samples(2 * RUNAWAY_SAMPLES, 95.98).unwrap_err();
    assert!(matches!(trip, Trip::HeatingFailed(_)), "{trip:?}");
    assert_eq!(after, WATCH_SAMPLES - 1);
    // On the hysteresis exactly: it is near, for as long as it likes.
    let mut checked = Checked { target: 100.0, power: 1.0, ..Checked::new() };
    checked.samples(2 * RUNAWAY_SAMPLES, 96.0).unwrap();
    // Farther below: the runaway period, because it has been near.
    let (after, trip) = checked.samples(2 * RUNAWAY_SAMPLES, 95.98).unwrap_err();
    assert!(matches!(trip, Trip::Runaway(_)), "{trip:?}");
    assert_eq!(after, RUNAWAY_SAMPLES - 1);
    // A temperature above the target is near as well.
    let mut checked = Checked::holding();
    checked.target = 50.0;
    checked.samples(10, TARGET).unwrap();
    checked.power = 0.3;
    checked.samples(RUNAWAY_SAMPLES - 1, 45.0).unwrap();
    assert!(matches!(checked.sample(45.0), Err(Trip::Runaway(_))));
}

/// A print of many layers has many dips below the hysteresis: only one that lasts counts.
#[test]
fn dips_that_end_do_not_add_up() {
    let mut checked = Checked::holding();
    for _ in 0..10 {
        checked.samples(RUNAWAY_SAMPLES - 1, TARGET - 4.5).unwrap();
        checked.sample(TARGET - 4.0).unwrap();
    }
    let (after, trip) = checked.samples(2 * RUNAWAY_SAMPLES, TARGET - 4.5).unwrap_err();
    assert!(matches!(trip, Trip::Runaway(_)), "{trip:?}");
    assert_eq!(after, RUNAWAY_SAMPLES - 1);
}

/// Samples without power that pass before a rise counts: heat on its way to the thermistor.
const SETTLING_SAMPLES: u32 = WATCH_SAMPLES / 4;

#[test]
fn heat_on_its_way_does_not_count_as_a_rise() {
    let mut checked = Checked::holding();
    checked.target = 0.0;
    checked.power = 0.0;
    // The rise to here arrives in the quarter of the watch period that it has.
    checked.samples(SETTLING_SAMPLES - 1, TARGET).unwrap();
    checked.sample(TARGET + 20.0).unwrap();
    checked.samples(10, TARGET + 29.9).unwrap();
    assert_eq!(checked.sample(TARGET + 30.0), Err(Trip::RisesUnpowered(TARGET + 30.0)));
    // One sample of power, however little, and it has that time again.
    let mut checked = Checked::holding();
    checked.target = 0.0;
    checked.power = 0.0;
    checked.samples(2 * SETTLING_SAMPLES, TARGET).unwrap();
    checked.power = 0.01;
    checked.sample(TARGET).unwrap();
    checked.power = 0.0;
    checked.samples(SETTLING_SAMPLES, TARGET + 30.0).unwrap();
    // The time is over: from here on it counts.
    assert_eq!(checked.sample(TARGET + 40.01), Err(Trip::RisesUnpowered(TARGET + 40.01)));
}

/// A heater that cools, and whose transistor then fails: ten degrees above the lowest, not
/// above where it began.
#[test]
fn a_rise_counts_from_the_lowest_temperature() {
    let mut checked = Checked::holding();
    checked.target = 0.0;
    checked.power = 0.0;
    checked.samples(SETTLING_SAMPLES + 1, TARGET).unwrap();
    let mut celsius = TARGET;
    while celsius > 100.0 {
        celsius -= 0.5;
        checked.sample(celsius).unwrap();
    }
    for _ in 0..19 {
        celsius += 0.5;
        checked.sample(celsius).unwrap();
    }
    assert_eq!(checked.sample(110.0), Err(Trip::RisesUnpowered(110.0)));
}

/// A nozzle over a hot bed takes hours for its ten degrees; that is not ten within a watch period.
#[test]
fn a_slow_rise_is_no_heater_s() {
    let mut checked = Checked::new();
    let mut celsius = 22.0;
    while celsius < 60.0 {
        // 9.9 degrees a watch period.
        celsius += 9.9 / WATCH_SAMPLES as f32;
        checked.sample(celsius).unwrap();
    }
    // The lowest is a watch period old when it is forgotten, not earlier.
    let mut checked = Checked::new();
    checked.samples(SETTLING_SAMPLES + 2, 22.0).unwrap();
    checked.sample(21.0).unwrap();
    checked.samples(WATCH_SAMPLES - 2, 30.0).unwrap();
    assert!(matches!(checked.sample(31.0), Err(Trip::RisesUnpowered(_))));
    let mut checked = Checked::new();
    checked.samples(SETTLING_SAMPLES + 2, 22.0).unwrap();
    checked.sample(21.0).unwrap();
    checked.samples(WATCH_SAMPLES, 30.0).unwrap();
    checked.sample(31.0).unwrap();
}

/// Ten degrees within a watch period of the last sample that was as low: a heater that has long
/// been at one temperature is not found later than one that has just cooled to it.
#[test]
fn a_rise_counts_from_the_last_time_that_it_was_as_low() {
    for steady in [1, WATCH_SAMPLES - 10, WATCH_SAMPLES + 10, 3 * WATCH_SAMPLES / 2] {
        let mut checked = Checked::new();
        checked.samples(SETTLING_SAMPLES + 2, 22.0).unwrap();
        (0..steady).try_for_each(|_| checked.sample(21.0)).unwrap();
        checked.samples(WATCH_SAMPLES - 2, 30.0).unwrap();
        assert_eq!(checked.sample(31.0), Err(Trip::RisesUnpowered(31.0)), "after {steady} samples");
    }
}

/// A bed whose transistor has failed closed, and that is too weak to rise by ten degrees.
#[test]
fn a_heater_that_stays_hot_without_power_is_on() {
    const COOLING_SAMPLES: u32 = 600 * SAMPLES_A_S;
    // From the start: after a reset it is still hot.
    for celsius in [80.0, 105.0] {
        let (after, trip) = Checked::new().samples(2 * COOLING_SAMPLES, celsius).unwrap_err();
        assert!(matches!(trip, Trip::StaysHotUnpowered(_)), "{trip:?}");
        assert_eq!(after, COOLING_SAMPLES);
    }
    // A warm heater is not a fault: a nozzle over a bed, a bed in a chamber.
    Checked::new().samples(2 * COOLING_SAMPLES, 79.9).unwrap();
    // Two degrees in time, again and again.
    let mut checked = Checked::new();
    let mut celsius = 110.0;
    while celsius > 80.0 {
        checked.samples(COOLING_SAMPLES - 2, celsius).unwrap();
        celsius -= 2.0;
    }
    // With power, however little, it is not a fault either.
    let mut checked = Checked::holding();
    for _ in 0..3 {
        checked.power = 0.0;
        checked.samples(COOLING_SAMPLES - 2, TARGET).unwrap();
        checked.power = 0.01;
        checked.sample(TARGET).unwrap();
    }
}

/// However large the profile's hysteresis: a thermistor that has fallen out reads the room,
/// which is never near.
#[test]
fn the_hysteresis_shrinks_towards_the_room() {
    let wide = HeaterWatch { runaway_celsius: 25.0, runaway_ms: 45_000, ..HeaterWatch::BED };
    let bed = HeaterSettings { watch: wide, ..settings(Heater::Bed) };
    let samples = 45 * SAMPLES_A_S;
    for (target, hysteresis) in [(100.0, 25.0), (85.0, 20.0), (55.0, 10.0), (40.0, 5.0), (35.0, 4.0), (20.0, 4.0)] {
        for (below, trips) in [(hysteresis - 0.05, false), (hysteresis + 0.05, true)] {
            let mut checked = Checked { settings: bed, safety: Safety::new(), target, power: 0.3 };
            checked.sample(target).unwrap();
            let outcome = checked.samples(samples, target - below);
            assert_eq!(outcome.is_err(), trips, "{below} below {target}: {outcome:?}");
        }
    }
}

/// Returns the number of samples, with these powers and an unchanged reading at the target, until
/// the reading counts as frozen.
fn frozen_after(powers: impl IntoIterator<Item = f32>) -> Option<u32> {
    let mut checked = Checked::holding();
    for (index, power) in (0..).zip(powers) {
        checked.power = power;
        match checked.sample(TARGET) {
            Ok(()) => {}
            Err(Trip::Frozen(celsius)) => {
                assert_eq!(celsius, TARGET);
                return Some(index);
            }
            Err(trip) => panic!("{trip:?}"),
        }
    }
    None
}

#[test]
fn a_reading_that_does_not_answer_a_change_of_power_is_frozen() {
    let steady = [0.3; 2 * RUNAWAY_SAMPLES as usize];
    assert_eq!(frozen_after(steady), None);
    // More power, and less, up to the ends of its range.
    for changed in [0.36, 0.24, 1.0, 0.0] {
        let powers = steady.into_iter().take(100).chain([changed; 2 * RUNAWAY_SAMPLES as usize]);
        assert_eq!(frozen_after(powers), Some(100 + RUNAWAY_SAMPLES - 1), "{changed}");
    }
    for changed in [0.34, 0.26] {
        let powers = steady.into_iter().chain([changed; 2 * RUNAWAY_SAMPLES as usize]);
        assert_eq!(frozen_after(powers), None, "{changed}");
    }
    // A change that is taken back should have been answered all the same.
    let powers = steady.into_iter().take(100).chain([1.0]).chain(steady);
    assert_eq!(frozen_after(powers), Some(100 + RUNAWAY_SAMPLES - 1));
}

#[test]
fn a_reading_that_changes_is_not_frozen() {
    let mut checked = Checked::holding();
    for _ in 0..3 {
        checked.power = 0.9;
        (0..RUNAWAY_SAMPLES - 1).try_for_each(|_| checked.sample(TARGET)).unwrap();
        // A step of the reading; the power is now the one that it belongs to.
        checked.sample(TARGET + 0.1).unwrap();
        (0..2 * RUNAWAY_SAMPLES).try_for_each(|_| checked.sample(TARGET + 0.1)).unwrap();
        checked.power = 0.3;
        checked.sample(TARGET).unwrap();
    }
}

/// Below the target, and with the heater off, other checks notice a frozen reading.
#[test]
fn only_a_heater_at_its_target_can_be_frozen() {
    let mut checked = Checked::new();
    for index in 0..3 * RUNAWAY_SAMPLES {
        checked.power = if index < 100 { 1.0 } else { 0.0 };
        checked.sample(22.0).unwrap();
    }
    // Switched off at its target.
    let mut checked = Checked::holding();
    checked.target = 0.0;
    checked.power = 0.0;
    (0..3 * RUNAWAY_SAMPLES).try_for_each(|_| checked.sample(TARGET)).unwrap();
}
