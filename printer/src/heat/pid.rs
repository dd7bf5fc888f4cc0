//! The control loop of a heater.

use super::gains::PidGains;
use super::sample_time::SAMPLE_S;

/// Share of the newest slope that the filtered one takes over, a sample: a time constant
/// of half a second.
const SLOPE_SHARE: f32 = 2.0 * SAMPLE_S;

/// Share of its integral that it forgets each sample while it is off: a time constant of 30 s. A
/// heater that is switched on again after seconds needs about the power that it needed; with that
/// power one that has cooled would overshoot.
const FORGOTTEN_SHARE: f32 = SAMPLE_S / 30.0;

/// A PID loop whose derivative is that of the temperature, so that a new target gives no kick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pid {
    /// Sum of errors times the integral gain: a power.
    accumulated: f32,
    /// Filtered, degrees a second.
    slope: f32,
    /// Temperature of the last sample; before the first one not a number.
    last_celsius: f32,
}

impl Pid {
    /// A loop at rest; the first sample sets the temperature.
    pub const fn new() -> Self {
        Self { accumulated: 0.0, slope: 0.0, last_celsius: f32::NAN }
    }

    /// Power for the next sample, 0 to 1; 0 where the target is 0. The fan's power is 0 to 255.
    pub fn power(&mut self, gains: &PidGains, celsius: f32, target: f32, fan_power: u8) -> f32 {
        let before = if self.last_celsius.is_nan() { celsius } else { self.last_celsius };
        self.last_celsius = celsius;
        self.slope += ((celsius - before) / SAMPLE_S - self.slope) * SLOPE_SHARE;
        if target <= 0.0 {
            self.accumulated -= self.accumulated * FORGOTTEN_SHARE;
            return 0.0;
        }
        let error = target - celsius;
        let fan = gains.fan * (target - PidGains::ROOM_CELSIUS).max(0.0) * (f32::from(fan_power) / 255.0);
        let unlimited = gains.proportional * error + self.accumulated - gains.derivative * self.slope + fan;
        // Anti-windup: the sum rests while the power is at an end of its range and would
        // be driven past it.
        let pushing_past = unlimited > 1.0 && error > 0.0 || unlimited < 0.0 && error < 0.0;
        if !pushing_past {
            // The error to come: on a long approach the sum of those that were would be more than
            // holds the target. It looks ahead by the derivative gain over the proportional one, s.
            let error = error - gains.derivative / gains.proportional * self.slope;
            self.accumulated = (self.accumulated + gains.integral * error * SAMPLE_S).clamp(0.0, 1.0);
        }
        unlimited.clamp(0.0, 1.0)
    }

    /// Forgets the power that the target takes.
    pub fn reset(&mut self) {
        self.accumulated = 0.0;
    }
}
