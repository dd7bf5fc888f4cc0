//! The heaters of the virtual board, their thermometers and the fan that cools them.

use super::ThermalModel;
use crate::{Fan, Heater, SensorError, ThermalBoard};

/// Two heaters with a thermal model each, and the part-cooling fan.
#[derive(Clone, Debug)]
pub struct VirtualHeaters {
    models: [ThermalModel; 2],
    powers: [f32; 2],
    fan_power: u8,
}

impl Default for VirtualHeaters {
    fn default() -> Self {
        Self::new()
    }
}

impl VirtualHeaters {
    /// Heaters that are off and cold.
    pub const fn new() -> Self {
        Self { models: [ThermalModel::nozzle(), ThermalModel::bed()], powers: [0.0; 2], fan_power: 0 }
    }

    /// Lets the heaters and what they heat run for a while, at most a second or so at a time.
    pub fn advance(&mut self, seconds: f32) {
        for (model, power) in self.models.iter_mut().zip(self.powers) {
            model.advance(power, self.fan_power, seconds);
        }
    }

    /// The fan's power, 0 to 255.
    pub const fn fan_power(&self) -> u8 {
        self.fan_power
    }
}

impl ThermalBoard for VirtualHeaters {
    fn celsius(&mut self, heater: Heater) -> Result<f32, SensorError> {
        Ok(self.models[heater.index()].celsius())
    }

    fn set_power(&mut self, heater: Heater, power: f32) {
        self.powers[heater.index()] = power.clamp(0.0, 1.0);
    }
}

impl Fan for VirtualHeaters {
    fn set_fan_power(&mut self, power: u8) {
        self.fan_power = power;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heater_heats_itself_only_and_the_fan_cools_the_nozzle() {
        let celsius = |heaters: &mut VirtualHeaters, heater| heaters.celsius(heater).unwrap_or(f32::NAN);
        let mut heaters = VirtualHeaters::new();
        let cold = celsius(&mut heaters, Heater::Bed);
        heaters.set_power(Heater::Nozzle, 7.0);
        heaters.advance(1.0);
        assert!(celsius(&mut heaters, Heater::Nozzle) > cold);
        assert_eq!(celsius(&mut heaters, Heater::Bed), cold);
        heaters.set_power(Heater::Nozzle, 0.0);
        let mut fanned = heaters.clone();
        fanned.set_fan_power(255);
        assert_eq!(fanned.fan_power(), 255);
        heaters.advance(1.0);
        fanned.advance(1.0);
        assert!(celsius(&mut fanned, Heater::Nozzle) < celsius(&mut heaters, Heater::Nozzle));
    }
}
