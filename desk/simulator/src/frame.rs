//! Models the frame: X and Y each hang on one or two springs that ring.
//!
//! A mode follows the command `u` as `x'' + 2 z w x' + w^2 x = w^2 u`. While the command is a
//! parabola in time, the solution is known in closed form, so the state is exact at every event,
//! however far apart two events are.

use crate::motion::Motion;
use std::f64::consts::TAU;
use std::fmt;
use std::ops::RangeInclusive;

/// Range of a mode's frequency, Hz.
pub const FREQUENCY_HZ: RangeInclusive<f64> = 1.0..=1000.0;

/// Range of a mode's damping ratio.
pub const DAMPING: RangeInclusive<f64> = 0.0..=0.95;

/// Mode of one coordinate and its state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    omega: f64,
    damping: f64,
    damped_omega: f64,
    position_mm: f64,
    speed_mm_per_s: f64,
}

impl Mode {
    /// Creates a mode at rest at 0.
    ///
    /// # Errors
    /// Frequency or damping is out of range.
    pub fn new(frequency_hz: f64, damping: f64) -> Result<Self, FrameError> {
        if !FREQUENCY_HZ.contains(&frequency_hz) {
            return Err(FrameError::Frequency(frequency_hz));
        }
        if !DAMPING.contains(&damping) {
            return Err(FrameError::Damping(damping));
        }
        let omega = TAU * frequency_hz;
        let damped_omega = omega * (1.0 - damping * damping).sqrt();
        Ok(Self { omega, damping, damped_omega, position_mm: 0.0, speed_mm_per_s: 0.0 })
    }

    /// Returns the position, mm.
    pub const fn position_mm(&self) -> f64 {
        self.position_mm
    }

    /// Returns the speed, mm/s.
    pub const fn speed_mm_per_s(&self) -> f64 {
        self.speed_mm_per_s
    }

    /// Returns the acceleration towards the commanded motion, mm/s^2.
    pub fn acceleration_mm_per_s2(&self, command: Motion) -> f64 {
        let away_mm = command.position_mm - self.position_mm;
        self.omega * (self.omega * away_mm - 2.0 * self.damping * self.speed_mm_per_s)
    }

    /// Returns the mode's motion without ringing: the particular solution that is
    /// itself a parabola.
    fn steady(&self, command: Motion) -> Motion {
        let lag_s = 2.0 * self.damping / self.omega;
        let compliance_s2 = (4.0 * self.damping * self.damping - 1.0) / (self.omega * self.omega);
        Motion {
            position_mm: command.position_mm - lag_s * command.speed_mm_per_s
                + compliance_s2 * command.acceleration_mm_per_s2,
            speed_mm_per_s: command.speed_mm_per_s - lag_s * command.acceleration_mm_per_s2,
            acceleration_mm_per_s2: command.acceleration_mm_per_s2,
        }
    }

    /// Advances time while the command continues from `command` at constant acceleration.
    pub fn advance(&mut self, time_s: f64, command: Motion) {
        let (start, end) = (self.steady(command), self.steady(command.after(time_s)));
        let away_mm = self.position_mm - start.position_mm;
        let away_mm_per_s = self.speed_mm_per_s - start.speed_mm_per_s;
        let decay = self.damping * self.omega;
        let (sine, cosine) = (self.damped_omega * time_s).sin_cos();
        let left = (-decay * time_s).exp();
        let cross = away_mm_per_s + decay * away_mm;
        let cross_speed = decay * away_mm_per_s + self.omega * self.omega * away_mm;
        self.position_mm = end.position_mm + left * (away_mm * cosine + cross / self.damped_omega * sine);
        self.speed_mm_per_s =
            end.speed_mm_per_s + left * (away_mm_per_s * cosine - cross_speed / self.damped_omega * sine);
    }

    /// Returns the amplitude with which the mode rings around its steady motion, mm.
    pub fn ringing_mm(&self, command: Motion) -> f64 {
        let steady = self.steady(command);
        let away_mm = self.position_mm - steady.position_mm;
        let away_mm_per_s = self.speed_mm_per_s - steady.speed_mm_per_s;
        away_mm.hypot((away_mm_per_s + self.damping * self.omega * away_mm) / self.damped_omega)
    }

    /// Changes the origin of the coordinate; nothing moves.
    fn shift(&mut self, by_mm: f64) {
        self.position_mm += by_mm;
    }
}

/// Second mode of both axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondMode {
    /// Frequency as a multiple of the first mode's.
    pub frequency_ratio: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Amplitude in the nozzle's position, relative to the first mode's.
    pub amplitude: f64,
}

impl Default for SecondMode {
    /// Returns a mode at 1.7 times the frequency, damping 0.04, -12 dB.
    fn default() -> Self {
        Self { frequency_ratio: 1.7, damping: 0.04, amplitude: 10f64.powf(-12.0 / 20.0) }
    }
}

/// Parameters of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameSettings {
    /// Undamped frequencies of the first modes of X and Y, Hz.
    pub frequency_hz: [f64; 2],
    /// Damping ratio of both first modes.
    pub damping: f64,
    /// Second mode of both axes, if any.
    pub second: Option<SecondMode>,
}

impl FrameSettings {
    /// Frame of a common printer: 50 Hz in X, 40 Hz in Y (the bed), damping 0.06.
    pub const USUAL: Self = Self { frequency_hz: [50.0, 40.0], damping: 0.06, second: None };
}

impl Default for FrameSettings {
    /// Returns [`Self::USUAL`].
    fn default() -> Self {
        Self::USUAL
    }
}

/// Reason why a frame cannot have these settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameError {
    /// A frequency is out of range; its value, Hz.
    Frequency(f64),
    /// A damping ratio is out of range; its value.
    Damping(f64),
    /// The second mode's amplitude is not within 0 to 1, or not a number; its value.
    Amplitude(f64),
}

impl fmt::Display for FrameError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (low, high) = (FREQUENCY_HZ.start(), FREQUENCY_HZ.end());
        match self {
            Self::Frequency(hz) => write!(out, "a mode of the frame is at {hz} Hz, expected {low} to {high} Hz"),
            Self::Damping(damping) => {
                write!(out, "the frame's damping ratio is {damping}, expected {} to {}", DAMPING.start(), DAMPING.end())
            }
            Self::Amplitude(amplitude) => {
                write!(out, "the second mode's amplitude is {amplitude} of the first one's, expected 0 to 1")
            }
        }
    }
}

impl std::error::Error for FrameError {}

/// Coordinate of the frame: the mean of its modes, weighted by their amplitudes.
#[derive(Clone, Copy, Debug)]
struct Axis {
    first: Mode,
    second: Option<(Mode, f64)>,
}

impl Axis {
    fn mean(&self, value: impl Fn(&Mode) -> f64) -> f64 {
        match &self.second {
            None => value(&self.first),
            Some((second, amplitude)) => (value(&self.first) + amplitude * value(second)) / (1.0 + amplitude),
        }
    }

    fn each(&mut self, mut act: impl FnMut(&mut Mode)) {
        act(&mut self.first);
        if let Some((second, _)) = &mut self.second {
            act(second);
        }
    }
}

/// X and Y of a frame, and their state.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    axes: [Axis; 2],
}

impl Frame {
    /// Creates a frame at rest with the nozzle at X0 Y0.
    ///
    /// # Errors
    /// A setting is out of range.
    pub fn new(settings: &FrameSettings) -> Result<Self, FrameError> {
        let axis = |frequency_hz: f64| -> Result<Axis, FrameError> {
            let second = match settings.second {
                None => None,
                Some(second) if !(0.0..=1.0).contains(&second.amplitude) => {
                    return Err(FrameError::Amplitude(second.amplitude));
                }
                Some(second) => {
                    Some((Mode::new(frequency_hz * second.frequency_ratio, second.damping)?, second.amplitude))
                }
            };
            Ok(Axis { first: Mode::new(frequency_hz, settings.damping)?, second })
        };
        let [x, y] = settings.frequency_hz;
        Ok(Self { axes: [axis(x)?, axis(y)?] })
    }

    /// Advances time while the motors' X and Y continue from `command` at constant accelerations.
    pub fn advance(&mut self, time_s: f64, command: [Motion; 2]) {
        for (axis, command) in self.axes.iter_mut().zip(command) {
            axis.each(|mode| mode.advance(time_s, command));
        }
    }

    /// Returns the nozzle's position, mm.
    pub fn position_mm(&self) -> [f64; 2] {
        self.axes.map(|axis| axis.mean(Mode::position_mm))
    }

    /// Returns the nozzle's speed, mm/s.
    pub fn speed_mm_per_s(&self) -> [f64; 2] {
        self.axes.map(|axis| axis.mean(Mode::speed_mm_per_s))
    }

    /// Returns the amplitude with which X and Y ring around the command, mm.
    pub fn ringing_mm(&self, command: [Motion; 2]) -> f64 {
        let [x, y] = [0, 1].map(|axis: usize| self.axes[axis].mean(|mode| mode.ringing_mm(command[axis])));
        x.hypot(y)
    }

    /// Changes the origin of the coordinates, as homing does; nothing moves.
    pub fn shift(&mut self, by_mm: [f64; 2]) {
        for (axis, by_mm) in self.axes.iter_mut().zip(by_mm) {
            axis.each(|mode| mode.shift(by_mm));
        }
    }
}

#[cfg(test)]
mod tests;
