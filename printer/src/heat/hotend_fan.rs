//! The hot end's own fan: it keeps the filament cold above a hot nozzle.

/// Nozzle temperature at which it is switched on, degrees Celsius.
const ON_CELSIUS: f32 = 50.0;
/// Nozzle temperature below which it is switched off, degrees Celsius.
const OFF_CELSIUS: f32 = 45.0;

/// Whether it turns.
#[derive(Clone, Copy, Debug)]
pub struct HotEndFan {
    is_on: bool,
}

impl HotEndFan {
    /// It turns: after a reset the nozzle may be hot.
    pub const fn new() -> Self {
        Self { is_on: true }
    }

    /// Takes the nozzle's temperature, degrees Celsius, and returns whether the fan is to turn. It turns if the temperature is
    /// unknown: `None`, or not a number.
    pub fn update(&mut self, celsius: Option<f32>) -> bool {
        match celsius {
            Some(celsius) if celsius < OFF_CELSIUS => self.is_on = false,
            Some(celsius) if celsius < ON_CELSIUS => {}
            Some(_) | None => self.is_on = true,
        }
        self.is_on
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_turns_above_a_hot_nozzle() {
        let mut fan = HotEndFan::new();
        // Between the two bounds it turns until a reading says that the nozzle is cold.
        let celsius = [49.9, 20.0, 49.9, 50.0, 49.9, 45.0, 44.9, 49.9];
        let turns = celsius.map(|celsius| fan.update(Some(celsius)));
        assert_eq!(turns, [true, false, false, true, true, true, false, false]);
    }

    #[test]
    fn it_turns_where_the_temperature_is_unknown() {
        for unknown in [None, Some(f32::NAN)] {
            let mut fan = HotEndFan::new();
            assert!(fan.update(unknown));
            assert!(!fan.update(Some(20.0)));
            assert!(fan.update(unknown));
        }
    }
}
