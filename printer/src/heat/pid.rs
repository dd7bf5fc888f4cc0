//! The control loop of a heater.

use crate::profile::HeaterSettings;

use super::sample_time::SAMPLE_S;

/// Share of the newest slope that the filtered one takes over, a sample: a time constant of half a second.
const SLOPE_SHARE: f32 = 2.0 * SAMPLE_S;

/// Share of its integral that it forgets each sample while it is off: a time constant of 30 s. A heater that is switched on
/// again after seconds needs about the power that it needed; with that power one that has cooled would overshoot.
const FORGOTTEN_SHARE: f32 = SAMPLE_S / 30.0;

/// A PID loop whose derivative is that of the temperature, so that a new target gives no kick.
#[derive(Clone, Copy, Debug)]
pub struct Pid {
    proportional: f32,
    integral: f32,
    derivative: f32,
    /// How far the integral looks ahead, s: the derivative gain over the proportional one.
    ahead_s: f32,
    /// Sum of errors times the integral gain: a power.
    accumulated: f32,
    /// Filtered, degrees a second.
    slope: f32,
    /// `None` before the first sample.
    last_celsius: Option<f32>,
}

impl Pid {
    /// At rest; the first sample sets the temperature.
    pub fn new(settings: &HeaterSettings) -> Self {
        let HeaterSettings { proportional, integral, derivative, .. } = *settings;
        let ahead_s = derivative / proportional;
        Self { proportional, integral, derivative, ahead_s, accumulated: 0.0, slope: 0.0, last_celsius: None }
    }

    /// Power for the next sample, 0 to 1; 0 where the target is 0.
    pub fn power(&mut self, celsius: f32, target: f32) -> f32 {
        let before = self.last_celsius.replace(celsius).unwrap_or(celsius);
        self.slope += ((celsius - before) / SAMPLE_S - self.slope) * SLOPE_SHARE;
        if target <= 0.0 {
            self.accumulated -= self.accumulated * FORGOTTEN_SHARE;
            return 0.0;
        }
        let error = target - celsius;
        let unlimited = self.proportional * error + self.accumulated - self.derivative * self.slope;
        // Anti-windup: the sum rests while the power is at an end of its range and would be driven past it.
        let pushing_past = unlimited > 1.0 && error > 0.0 || unlimited < 0.0 && error < 0.0;
        if !pushing_past {
            // The error to come: on a long approach the sum of those that were would be more than holds the target.
            let error = error - self.ahead_s * self.slope;
            self.accumulated = (self.accumulated + self.integral * error * SAMPLE_S).clamp(0.0, 1.0);
        }
        unlimited.clamp(0.0, 1.0)
    }

    /// Forgets the power that the target takes.
    pub fn reset(&mut self) {
        self.accumulated = 0.0;
    }
}
