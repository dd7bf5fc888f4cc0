//! The hot end's own fan: it keeps the filament cold above a hot nozzle.

/// At this temperature of the nozzle it is switched on, degrees Celsius ...
const ON_CELSIUS: f32 = 50.0;
/// ... and below this one off.
const OFF_CELSIUS: f32 = 45.0;

/// Whether it turns.
#[derive(Clone, Copy, Debug, Default)]
pub struct HotEndFan {
    is_on: bool,
}

impl HotEndFan {
    /// Takes the nozzle's temperature, degrees Celsius, and says whether the fan is to turn. A temperature that is none
    /// changes nothing.
    pub fn update(&mut self, celsius: f32) -> bool {
        if celsius >= ON_CELSIUS {
            self.is_on = true;
        } else if celsius < OFF_CELSIUS {
            self.is_on = false;
        }
        self.is_on
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_turns_above_a_hot_nozzle() {
        let mut fan = HotEndFan::default();
        let heard = [20.0, 49.9, 50.0, 49.9, 45.0, f32::NAN, 44.9, f32::NAN, 49.9].map(|celsius| fan.update(celsius));
        assert_eq!(heard, [false, false, true, true, true, true, false, false, false]);
    }
}
