//! One heater: its thermometer, its checks and its loop.

use super::pid::Pid;
use super::relay;
use super::relay::Relay;
use super::safety::{Safety, Trip};
use super::thermometer::{MEDIAN_OF, Thermometer};
use crate::settings::profile::heaters::HeaterSettings;

/// Loop that computes a heater's power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loop {
    /// The loop holds its target.
    Pid(Pid),
    /// The heater is being tuned (M303).
    Relay(Relay),
}

/// One heater.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    pub settings: HeaterSettings,
    pub thermometer: Thermometer,
    pub safety: Safety,
    pub control: Loop,
    /// Last temperature, degrees Celsius; `None` before the first.
    pub celsius: Option<f32>,
    pub target: f32,
    pub power: f32,
}

impl Channel {
    /// A heater that is off, with its first readings.
    pub fn new(settings: HeaterSettings, readings: [u16; MEDIAN_OF]) -> Self {
        let thermometer = Thermometer::new(settings.thermistor, readings);
        // Without a temperature, the first sample trips the checks.
        let celsius = thermometer.celsius().ok();
        let (safety, control) = (Safety::new(), Loop::Pid(Pid::new()));
        Self { settings, thermometer, safety, control, celsius, target: 0.0, power: 0.0 }
    }

    /// Takes a sample; the power is unchanged.
    pub fn sample(&mut self, reading: u16) -> Result<(), Trip> {
        self.thermometer.add(reading);
        let celsius = self.thermometer.celsius();
        self.celsius = celsius.ok().or(self.celsius);
        let is_tuned = matches!(self.control, Loop::Relay(_));
        // A channel with only a thermometer has no heater that could fail to reach its target.
        let target = if self.settings.is_heated { self.target } else { 0.0 };
        self.safety.check(&self.settings, celsius, target, self.power, is_tuned)
    }

    /// Computes the power for the next sample. A heater without a temperature gets none.
    pub fn control(&mut self, fan_power: u8) {
        self.power = match (self.celsius, &mut self.control) {
            (None, _) => 0.0,
            (Some(_), _) if !self.settings.is_heated => 0.0,
            (Some(celsius), Loop::Pid(pid)) => pid.power(&self.settings.gains, celsius, self.target, fan_power),
            (Some(celsius), Loop::Relay(relay)) => {
                let longest = if self.settings.is_warmed_by_others {
                    relay::MAX_HALF_CYCLE_OF_CHAMBER_SAMPLES
                } else {
                    relay::MAX_HALF_CYCLE_SAMPLES
                };
                let power = relay.power(celsius, self.target, longest);
                if relay.has_ended() {
                    self.target = 0.0;
                }
                power
            }
        };
    }

    /// Switches the heater off.
    pub fn off(&mut self) {
        self.target = 0.0;
        self.power = 0.0;
        match &mut self.control {
            Loop::Pid(pid) => pid.reset(),
            Loop::Relay(_) => self.control = Loop::Pid(Pid::new()),
        }
    }
}
