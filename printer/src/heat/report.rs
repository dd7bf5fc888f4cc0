//! Heaters, fans and faults as reports show them.

use core::fmt;

use ferrostep_gcode::Real;
use ferrostep_hal_shim::Heater;

use super::safety::Trip;

/// A heater as a report shows it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeaterStatus {
    /// Temperature, degrees Celsius.
    pub celsius: f32,
    /// Target, degrees Celsius; 0 = off.
    pub target_celsius: f32,
    /// Power, 0 to 1.
    pub power: f32,
}

/// A fan as a report shows it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FanStatus {
    /// Power, 0 to 255.
    pub power: u8,
    /// Turns a minute over the last seconds; `None` without a tachometer.
    pub rpm: Option<u16>,
}

/// Reason why all heaters are off: until M999, or until a reset ([`Trip::needs_reset`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatFault {
    /// The heater.
    pub heater: Heater,
    /// The fault that a check has found.
    pub trip: Trip,
}

impl fmt::Display for HeatFault {
    /// The line that hosts take for a thermal error; `kill() called` must follow it.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self.heater {
            Heater::Nozzle => "E0",
            Heater::Bed => "bed",
            Heater::Chamber => "chamber",
            Heater::Nozzle1 => "E1",
        };
        write!(out, "Error:{}, system stopped! Heater_ID: {name}", self.trip)?;
        match self.trip {
            Trip::Sensor(_) => Ok(()),
            Trip::TooHot(celsius)
            | Trip::TooCold(celsius)
            | Trip::HeatingFailed(celsius)
            | Trip::Runaway(celsius)
            | Trip::RisesUnpowered(celsius)
            | Trip::StaysHotUnpowered(celsius)
            | Trip::Frozen(celsius) => write!(out, " (temp: {})", Real::fixed(celsius, 2)),
        }
    }
}
