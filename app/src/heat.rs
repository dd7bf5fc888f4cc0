//! The heaters: their control, and on the bench their models. On printer boards there is no code for them yet: their
//! pins are low, and nobody makes up a temperature.

use ferrostep_hal_shim::Heater;
use ferrostep_hal_shim::ThermalBoard;
use ferrostep_hal_shim::virtual_board::VirtualHeaters;
use ferrostep_printer::heat::{HeatControl, HeatFault};
use ferrostep_printer::{Equipment, HeaterStatus, Profile};
use ferrostep_stm32f4::board::VIRTUAL_SENSORS;

/// Interval of heater control, ms.
pub const INTERVAL_MS: u32 = 100;

/// What of the board the firmware can use.
pub const EQUIPMENT: Equipment = if VIRTUAL_SENSORS { Equipment::ALL } else { Equipment::NONE };

/// Control and heaters.
pub struct Heat {
    control: HeatControl,
    /// The models, if this board has them.
    heaters: Option<VirtualHeaters>,
    fault: Option<HeatFault>,
}

impl Heat {
    /// Cold heaters with their first readings, so that the first command finds temperatures.
    pub fn new(profile: &Profile) -> Self {
        let control = HeatControl::new(profile.nozzle, profile.bed);
        let mut heat = Self { control, heaters: VIRTUAL_SENSORS.then(VirtualHeaters::new), fault: None };
        if let Some(heaters) = &mut heat.heaters {
            heat.fault = heat.control.update(heaters, 0.0).err();
        }
        heat
    }

    /// One interval of control. `false` once a heater or thermometer has failed; then all heaters are off for good.
    pub fn update(&mut self, fan_power: u8) -> bool {
        let seconds = INTERVAL_MS as f32 * 1e-3;
        if let Some(heaters) = &mut self.heaters {
            ferrostep_hal_shim::Fan::set_fan_power(heaters, fan_power);
            heaters.advance(seconds);
            self.fault = self.control.update(heaters, seconds).err();
        }
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
        if let Some(heaters) = &mut self.heaters {
            for heater in Heater::ALL {
                heaters.set_power(heater, 0.0);
            }
        }
    }
}
