//! The heaters: their control, and on the bench their models. On printer boards there is no code for them yet: their
//! pins are low, and nobody makes up a temperature.

use ferrostep_hal_shim::virtual_board::VirtualHeaters;
use ferrostep_hal_shim::{Fan, Heater, ThermalBoard};
use ferrostep_printer::heat::{HeatControl, HeatFault, SAMPLE_MS};
use ferrostep_printer::{Equipment, HeaterStatus, Profile};
use ferrostep_stm32f4::board::VIRTUAL_SENSORS;

/// What of the board the firmware can use.
pub const EQUIPMENT: Equipment =
    if VIRTUAL_SENSORS { Equipment::ALL } else { Equipment { end_stops: true, ..Equipment::NONE } };

/// The heaters that the firmware can use.
pub struct Heat {
    modelled: Option<Modelled>,
}

/// Control and heaters.
struct Modelled {
    control: HeatControl,
    heaters: VirtualHeaters,
}

impl Heat {
    /// Cold heaters with their first readings, so that the first command finds temperatures.
    pub fn new(profile: &Profile) -> Self {
        let modelled = VIRTUAL_SENSORS.then(|| {
            let mut heaters = profile.virtual_heaters();
            Modelled { control: HeatControl::new(profile.nozzle, profile.bed, &mut heaters), heaters }
        });
        Self { modelled }
    }

    /// One sample of control, every [`SAMPLE_MS`].
    ///
    /// # Errors
    /// A heater or thermometer has failed, and all heaters are off; told once.
    pub fn update(&mut self, fan_power: u8) -> Result<(), HeatFault> {
        let Some(Modelled { control, heaters }) = &mut self.modelled else { return Ok(()) };
        heaters.set_fan_power(fan_power);
        heaters.advance(SAMPLE_MS as f32 * 1e-3);
        control.update(heaters)
    }

    /// Why the heaters are off until M999, if they are.
    pub fn fault(&self) -> Option<HeatFault> {
        self.modelled.as_ref().and_then(|modelled| modelled.control.fault())
    }

    /// Sets a target, degrees Celsius; 0 is off. Without heaters that is what they are, and [`EQUIPMENT`] has any other
    /// refused.
    pub fn set_target(&mut self, heater: Heater, celsius: f32) {
        if let Some(modelled) = &mut self.modelled {
            modelled.control.set_target(heater, celsius);
        }
    }

    /// How a heater is.
    pub fn status(&self, heater: Heater) -> HeaterStatus {
        self.modelled.as_ref().map_or_else(HeaterStatus::default, |modelled| modelled.control.status(heater))
    }

    /// Switches all heaters off, now.
    pub fn all_off(&mut self) {
        if let Some(Modelled { control, heaters }) = &mut self.modelled {
            control.all_off();
            for heater in Heater::ALL {
                heaters.set_power(heater, 0.0);
            }
        }
    }

    /// M999.
    ///
    /// # Errors
    /// A fault is still there, and all heaters stay off.
    pub fn restart(&mut self) -> Result<(), HeatFault> {
        match &mut self.modelled {
            Some(modelled) => modelled.control.restart(),
            None => Ok(()),
        }
    }
}
