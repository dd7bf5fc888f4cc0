//! Detects that the heaters' model need not be stepped.

use ferrostep_hal_shim::Heater;

/// Samples over which the temperatures must have stayed: 10 s, as a loop whose integral
/// works slowly creeps.
const REST_SAMPLES: u32 = 1000;

/// The most by which a heater that is off may cool within them, degrees: a nozzle half a degree
/// above the air cools so.
const OFF_BAND_CELSIUS: f32 = 0.05;

/// The most by which a heater with a target may change within them, degrees: it creeps towards its
/// target, or follows the steps of its thermistor's readings.
const HELD_BAND_CELSIUS: f32 = 0.11;

/// Maximum distance of a resting heater from its target, degrees Celsius.
const HELD_CELSIUS: f32 = 0.5;

/// A heater after a sample.
#[derive(Clone, Copy, Debug)]
pub struct HeaterSample {
    /// True temperature, degrees Celsius.
    pub celsius: f32,
    /// The target, 0 for off.
    pub target_celsius: f32,
}

/// Watches the heaters until all are at rest for [`REST_SAMPLES`]: off and no longer cooling, or
/// held at their targets.
///
/// From there on the model would only repeat itself: until a target is changed no check can trip,
/// no wait can end, and all temperatures stay within [`HELD_CELSIUS`]; but for a chamber that only
/// the bed warms: it still gains up to 4 degrees in the hours after.
#[derive(Clone, Copy, Debug, Default)]
pub struct HeatAtRest {
    samples: u32,
    lowest: [f32; Heater::COUNT],
    highest: [f32; Heater::COUNT],
}

impl HeatAtRest {
    /// Takes the heaters as they are after a sample.
    pub fn note(&mut self, heaters: [HeaterSample; Heater::COUNT]) {
        self.samples = self.samples.saturating_add(1);
        let mut stays = self.samples > 1;
        for (heater, (lowest, highest)) in heaters.iter().zip(self.lowest.iter_mut().zip(&mut self.highest)) {
            *lowest = lowest.min(heater.celsius);
            *highest = highest.max(heater.celsius);
            let moved = *highest - *lowest;
            stays &= if heater.target_celsius > 0.0 {
                (heater.celsius - heater.target_celsius).abs() <= HELD_CELSIUS && moved <= HELD_BAND_CELSIUS
            } else {
                moved <= OFF_BAND_CELSIUS
            };
        }
        if !stays {
            let celsius = heaters.map(|heater| heater.celsius);
            *self = Self { samples: 1, lowest: celsius, highest: celsius };
        }
    }

    /// A target or a failure has changed.
    pub fn disturb(&mut self) {
        *self = Self::default();
    }

    /// Returns true if all heaters are at rest.
    pub const fn is_at_rest(&self) -> bool {
        self.samples >= REST_SAMPLES
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(samples: impl IntoIterator<Item = [(f32, f32); 2]>) -> HeatAtRest {
        let mut rest = HeatAtRest::default();
        for heaters in samples {
            let [nozzle, bed] = heaters.map(|(celsius, target_celsius)| HeaterSample { celsius, target_celsius });
            let cold = HeaterSample { celsius: 22.0, target_celsius: 0.0 };
            rest.note([nozzle, bed, cold, cold]);
        }
        rest
    }

    #[test]
    fn off_and_cold_or_held_for_long_enough_is_rest() {
        let steady = |count, heaters| after(std::iter::repeat_n(heaters, count));
        assert!(!steady(999, [(22.0, 0.0), (60.1, 60.0)]).is_at_rest());
        let mut rest = steady(1000, [(22.0, 0.0), (60.1, 60.0)]);
        assert!(rest.is_at_rest());
        rest.disturb();
        assert!(!rest.is_at_rest());
    }

    #[test]
    fn a_heater_off_its_target_or_moving_is_not_at_rest() {
        // A heater that is too weak for its target.
        assert!(!after(std::iter::repeat_n([(150.0, 210.0), (22.0, 0.0)], 5000)).is_at_rest());
        let drift = |a_sample: f32| {
            after((0..4500_u16).map(|sample| [(210.0, 210.0), (22.6 - a_sample * f32::from(sample), 0.0)]))
        };
        assert!(!drift(0.000_1).is_at_rest());
        assert!(drift(0.000_01).is_at_rest());
        // A loop that swings around its target.
        let swing = |celsius: f32| {
            after((0..5000_u16).map(|sample| [(210.0 + celsius * f32::from(sample / 50 % 2), 210.0), (22.0, 0.0)]))
        };
        assert!(!swing(0.3).is_at_rest());
        assert!(swing(0.1).is_at_rest());
    }
}
