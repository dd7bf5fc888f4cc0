//! The heaters: their control, and on the bench their models.

use ferrostep_hal_shim::virtual_board::VirtualHeaters;
use ferrostep_hal_shim::{Fan, Heater, ThermalBoard};
use ferrostep_printer::heat::{HeatControl, HeatFault, SAMPLE_MS};
use ferrostep_printer::{HeaterStatus, Profile};

/// Control and heaters.
pub struct Heat {
    control: HeatControl,
    heaters: VirtualHeaters,
}

impl Heat {
    /// Cold heaters with their first readings, so that the first command finds temperatures.
    pub fn new(profile: &Profile) -> Self {
        let mut heaters = profile.virtual_heaters();
        Self { control: HeatControl::new(profile.nozzle, profile.bed, &mut heaters), heaters }
    }

    /// One sample of control, every [`SAMPLE_MS`].
    ///
    /// # Errors
    /// A heater or thermometer has failed, and all heaters are off; told once.
    pub fn update(&mut self, fan_power: u8) -> Result<(), HeatFault> {
        self.heaters.set_fan_power(fan_power);
        self.heaters.advance(SAMPLE_MS as f32 * 1e-3);
        self.control.update(&mut self.heaters)
    }

    /// Why the heaters are off until M999, if they are.
    pub fn fault(&self) -> Option<HeatFault> {
        self.control.fault()
    }

    /// Sets a target, degrees Celsius; 0 is off.
    pub fn set_target(&mut self, heater: Heater, celsius: f32) {
        self.control.set_target(heater, celsius);
    }

    /// How a heater is.
    pub fn status(&self, heater: Heater) -> HeaterStatus {
        self.control.status(heater)
    }

    /// Switches all heaters off, now.
    pub fn all_off(&mut self) {
        self.control.all_off();
        for heater in Heater::ALL {
            self.heaters.set_power(heater, 0.0);
        }
    }

    /// M999.
    ///
    /// # Errors
    /// A fault is still there, and all heaters stay off.
    pub fn restart(&mut self) -> Result<(), HeatFault> {
        self.control.restart()
    }
}
