//! The heaters: their control, and on the bench their models.

use ferrostep_hal_shim::Heater;
use ferrostep_hal_shim::ThermalBoard;
use ferrostep_hal_shim::virtual_board::VirtualHeaters;
use ferrostep_printer::heat::{HeatControl, HeatFault};
use ferrostep_printer::{HeaterStatus, Profile};

/// Interval of heater control, ms.
pub const INTERVAL_MS: u32 = 100;

/// Control and heaters.
pub struct Heat {
    control: HeatControl,
    heaters: VirtualHeaters,
    fault: Option<HeatFault>,
}

impl Heat {
    /// Cold heaters with their first readings, so that the first command finds temperatures.
    pub fn new(profile: &Profile) -> Self {
        let control = HeatControl::new(profile.nozzle, profile.bed);
        let mut heat = Self { control, heaters: VirtualHeaters::new(), fault: None };
        heat.fault = heat.control.update(&mut heat.heaters, 0.0).err();
        heat
    }

    /// One interval of control. `false` once a heater or thermometer has failed; then all heaters are off for good.
    pub fn update(&mut self, fan_power: u8) -> bool {
        let seconds = INTERVAL_MS as f32 * 1e-3;
        ferrostep_hal_shim::Fan::set_fan_power(&mut self.heaters, fan_power);
        self.heaters.advance(seconds);
        self.fault = self.control.update(&mut self.heaters, seconds).err();
        self.fault.is_none()
    }

    /// Why the heaters are off for good, if they are.
    pub fn fault(&self) -> Option<HeatFault> {
        self.fault
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
}
