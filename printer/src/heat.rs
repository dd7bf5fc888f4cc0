//! Heater control: one PID loop a heater, and the limits that switch everything off.

use core::fmt;

use ferrostep_gcode::Real;
use ferrostep_hal_shim::{Heater, SensorError, ThermalBoard};

use crate::ports::HeaterStatus;
use crate::profile::HeaterSettings;

/// Why all heaters are off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HeatFault {
    /// A thermometer has no reading.
    Sensor(Heater, SensorError),
    /// At or above the maximum.
    TooHot(Heater, f32),
    /// Below the minimum: the thermometer is likely disconnected.
    TooCold(Heater, f32),
}

impl fmt::Display for HeatFault {
    /// The line that hosts take for a thermal error; `kill() called` follows it.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, heater) = match self {
            Self::TooHot(heater, _) | Self::Sensor(heater, SensorError::Shorted) => ("MAXTEMP", heater),
            Self::TooCold(heater, _) | Self::Sensor(heater, SensorError::Open) => ("MINTEMP", heater),
        };
        let name = match heater {
            Heater::Nozzle => "E0",
            Heater::Bed => "bed",
        };
        write!(out, "Error:{what} triggered, system stopped! Heater_ID: {name}")?;
        match self {
            Self::TooHot(_, celsius) | Self::TooCold(_, celsius) => {
                write!(out, " (temp: {})", Real::fixed(*celsius, 2))
            }
            Self::Sensor(..) => Ok(()),
        }
    }
}

/// Temperature filter of the derivative: share of the newest slope a second.
const DERIVATIVE_RATE_PER_S: f32 = 2.0;

#[derive(Clone, Copy, Debug)]
struct Loop {
    settings: HeaterSettings,
    celsius: f32,
    target: f32,
    power: f32,
    /// Pre-multiplied by the integral gain, so it is a power.
    integral: f32,
    /// Filtered slope, degrees a second.
    slope: f32,
    has_reading: bool,
}

impl Loop {
    fn new(settings: HeaterSettings) -> Self {
        Self { settings, celsius: 0.0, target: 0.0, power: 0.0, integral: 0.0, slope: 0.0, has_reading: false }
    }

    fn update(&mut self, celsius: f32, seconds: f32) {
        if self.has_reading && seconds > 0.0 {
            let share = (DERIVATIVE_RATE_PER_S * seconds).min(1.0);
            self.slope += ((celsius - self.celsius) / seconds - self.slope) * share;
        }
        self.celsius = celsius;
        self.has_reading = true;
        if self.target <= 0.0 {
            self.power = 0.0;
            self.integral = 0.0;
            return;
        }
        let error = self.target - celsius;
        let unlimited = self.settings.proportional * error + self.integral - self.settings.derivative * self.slope;
        // Anti-windup: the integral rests while the power is at an end of its range and would be driven past it.
        let pushing_past = unlimited > 1.0 && error > 0.0 || unlimited < 0.0 && error < 0.0;
        if !pushing_past {
            self.integral = (self.integral + self.settings.integral * error * seconds).clamp(0.0, 1.0);
        }
        self.power = unlimited.clamp(0.0, 1.0);
    }
}

/// Control of all heaters.
#[derive(Clone, Copy, Debug)]
pub struct HeatControl {
    loops: [Loop; 2],
    fault: Option<HeatFault>,
}

impl HeatControl {
    /// All heaters off.
    pub fn new(nozzle: HeaterSettings, bed: HeaterSettings) -> Self {
        Self { loops: [Loop::new(nozzle), Loop::new(bed)], fault: None }
    }

    /// Reads every thermometer and sets every heater; to be called at a steady pace, `seconds` apart.
    ///
    /// A reading outside its range switches all heaters off, here and from now on.
    pub fn update(&mut self, board: &mut impl ThermalBoard, seconds: f32) -> Result<(), HeatFault> {
        for heater in Heater::ALL {
            let control = &mut self.loops[heater.index()];
            match board.celsius(heater) {
                Ok(celsius) if celsius >= control.settings.max_celsius => {
                    self.fault = self.fault.or(Some(HeatFault::TooHot(heater, celsius)));
                }
                Ok(celsius) if celsius.is_nan() || celsius < control.settings.min_celsius => {
                    self.fault = self.fault.or(Some(HeatFault::TooCold(heater, celsius)));
                }
                Ok(celsius) => control.update(celsius, seconds),
                Err(error) => self.fault = self.fault.or(Some(HeatFault::Sensor(heater, error))),
            }
        }
        if self.fault.is_some() {
            self.all_off();
        }
        for heater in Heater::ALL {
            board.set_power(heater, self.loops[heater.index()].power);
        }
        self.fault.map_or(Ok(()), Err)
    }

    /// Sets a target, degrees Celsius; anything not above 0 switches the heater off. Ignored after a fault.
    pub fn set_target(&mut self, heater: Heater, celsius: f32) {
        if self.fault.is_none() {
            self.loops[heater.index()].target = if celsius > 0.0 { celsius } else { 0.0 };
        }
    }

    /// Switches all heaters off; the board hears of it with the next [`Self::update`].
    pub fn all_off(&mut self) {
        for control in &mut self.loops {
            control.target = 0.0;
            control.power = 0.0;
            control.integral = 0.0;
        }
    }

    /// How a heater is.
    pub fn status(&self, heater: Heater) -> HeaterStatus {
        let control = &self.loops[heater.index()];
        HeaterStatus { celsius: control.celsius, target_celsius: control.target, power: control.power }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Board {
        celsius: [Result<f32, SensorError>; 2],
        power: [f32; 2],
    }

    impl ThermalBoard for Board {
        fn celsius(&mut self, heater: Heater) -> Result<f32, SensorError> {
            self.celsius[heater.index()]
        }
        fn set_power(&mut self, heater: Heater, power: f32) {
            self.power[heater.index()] = power;
        }
    }

    fn settings() -> HeaterSettings {
        HeaterSettings {
            min_celsius: 5.0,
            max_celsius: 275.0,
            proportional: 0.05,
            integral: 0.002,
            derivative: 0.1,
            residency_window_celsius: 1.0,
            residency_ms: 10_000,
        }
    }

    #[test]
    fn a_reading_outside_its_range_switches_everything_off_for_good() {
        for bad in [Ok(275.0), Ok(-3.0), Ok(f32::NAN), Err(SensorError::Open), Err(SensorError::Shorted)] {
            let mut control = HeatControl::new(settings(), settings());
            let mut board = Board { celsius: [Ok(20.0), Ok(20.0)], power: [0.0; 2] };
            control.set_target(Heater::Nozzle, 200.0);
            control.set_target(Heater::Bed, 60.0);
            assert!(control.update(&mut board, 0.1).is_ok());
            assert_eq!(board.power, [1.0, 1.0]);
            board.celsius[1] = bad;
            assert!(control.update(&mut board, 0.1).is_err());
            assert_eq!(board.power, [0.0, 0.0]);
            board.celsius[1] = Ok(20.0);
            control.set_target(Heater::Nozzle, 200.0);
            assert!(control.update(&mut board, 0.1).is_err());
            assert_eq!(board.power, [0.0, 0.0]);
        }
    }

    #[test]
    fn a_target_of_zero_is_off() {
        let mut control = HeatControl::new(settings(), settings());
        let mut board = Board { celsius: [Ok(20.0), Ok(20.0)], power: [0.5; 2] };
        control.set_target(Heater::Nozzle, f32::NAN);
        assert!(control.update(&mut board, 0.1).is_ok());
        assert_eq!(board.power, [0.0, 0.0]);
    }
}
