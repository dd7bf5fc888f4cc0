//! Input shapers: impulses that, convolved with a command, leave a mode of the frame at rest.
//!
//! A shaper is a list of delays and weights, which sum to 1. It is made for a mode with an undamped
//! frequency and a damping ratio. [`Shaper::residual`] computes the vibration of another mode that
//! it leaves.
//!
//! Sources: ZV, ZVD and ZVDD: Singer and Seering 1990; EI and its humps: Singhose, Seering and
//! Singer 1996 and, with damping, the polynomials that Singhose and Vaughan published, as Klipper
//! and RepRapFirmware use them since 2025; MZV and its general form: as Klipper defines them.

mod even_spacing;
mod kind;
mod name;
#[cfg(test)]
mod tests;

use std::f64::consts::{PI, TAU};
use std::fmt;

pub use even_spacing::{EvenSpacing, EvenSpacingError};
pub use kind::ShaperKind;
pub use name::UnknownShaper;

/// Vibration that shapers with humps leave on purpose: the customary 5 %.
const TOLERANCE: f64 = 0.05;

/// Range of the frequencies that a shaper can be made for, Hz: below it, the delays are longer than
/// a move; above it, frames have no modes.
pub const FREQUENCY_HZ: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

/// Reason why a shaper cannot be made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShaperError {
    /// The frequency is not within [`FREQUENCY_HZ`]; its value, Hz.
    Frequency(f64),
    /// The damping ratio is negative, or larger than the maximum for the shaper.
    Damping {
        /// Damping ratio asked for.
        damping: f64,
        /// Maximum damping ratio.
        max: f64,
    },
}

impl fmt::Display for ShaperError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frequency(hz) => write!(
                out,
                "the shaper's frequency is {hz} Hz, expected {} to {} Hz",
                FREQUENCY_HZ.start(),
                FREQUENCY_HZ.end()
            ),
            Self::Damping { damping, max } => {
                write!(out, "the shaper's damping ratio is {damping}, expected 0 to {max} for this shaper")
            }
        }
    }
}

impl std::error::Error for ShaperError {}

/// Impulse of a shaper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impulse {
    /// Share of the command; a shaper's weights sum to 1.
    pub weight: f64,
    /// Delay after the command, s; negative is earlier.
    pub delay_s: f64,
}

/// Input shaper: a list of impulses, in order of their delays.
#[derive(Clone, Debug, PartialEq)]
pub struct Shaper {
    impulses: Vec<Impulse>,
}

impl Shaper {
    /// Returns a shaper of one impulse, which leaves the command unchanged.
    pub fn identity() -> Self {
        Self { impulses: vec![Impulse { weight: 1.0, delay_s: 0.0 }] }
    }

    /// Creates a shaper for a mode with this undamped frequency and damping ratio. Its first
    /// impulse has no delay.
    ///
    /// # Errors
    /// The frequency or the damping is outside the shaper's range.
    pub fn new(kind: ShaperKind, frequency_hz: f64, damping: f64) -> Result<Self, ShaperError> {
        if !FREQUENCY_HZ.contains(&frequency_hz) {
            return Err(ShaperError::Frequency(frequency_hz));
        }
        let max = kind.max_damping();
        if !(0.0..=max).contains(&damping) {
            return Err(ShaperError::Damping { damping, max });
        }
        let root = (1.0 - damping * damping).sqrt();
        let period_s = 1.0 / (frequency_hz * root);
        // Decay of the vibration in half a damped period, and in the fraction `part` of one.
        let half = (-damping * PI / root).exp();
        let decay = |part: f64| (-TAU * part * damping / root).exp();
        let halves = |weights: &[f64]| {
            weights.iter().enumerate().map(|(index, weight)| (*weight, 0.5 * index as f64 * period_s)).collect()
        };
        let v = TOLERANCE;
        let pairs: Vec<(f64, f64)> = match kind {
            ShaperKind::None => vec![(1.0, 0.0)],
            ShaperKind::Zv => halves(&[1.0, half]),
            ShaperKind::Zvd => halves(&[1.0, 2.0 * half, half.powi(2)]),
            // ANCHOR: zvdd
            ShaperKind::Zvdd => halves(&[1.0, 3.0 * half, 3.0 * half.powi(2), half.powi(3)]),
            // ANCHOR_END: zvdd
            ShaperKind::Mzv => {
                let outer = 1.0 - 0.5f64.sqrt();
                let inner = 2f64.sqrt() - 1.0;
                let each = decay(0.375);
                vec![(outer, 0.0), (inner * each, 0.375 * period_s), (outer * each * each, 0.75 * period_s)]
            }
            ShaperKind::EvenMzv(spacing) => {
                let step = spacing.step_periods();
                let each = decay(step);
                let powers = std::iter::successors(Some(1.0), |power| Some(power * each));
                let delays = (0..).map(|index| f64::from(index) * step * period_s);
                spacing.weights().iter().zip(powers).zip(delays).map(|((w, power), delay)| (w * power, delay)).collect()
            }
            ShaperKind::EiOld => halves(&[0.25 * (1.0 + v), 0.5 * (1.0 - v) * half, 0.25 * (1.0 + v) * half.powi(2)]),
            ShaperKind::Ei => ei_with_damping(v, damping, period_s),
            ShaperKind::TwoHumpEiOld => {
                let v2 = v * v;
                let x = (v2 * ((1.0 - v2).sqrt() + 1.0)).cbrt();
                let outer = (3.0 * x * x + 2.0 * x + 3.0 * v2) / (16.0 * x);
                halves(&[outer, (0.5 - outer) * half, (0.5 - outer) * half.powi(2), outer * half.powi(3)])
            }
            ShaperKind::ThreeHumpEiOld => {
                let outer = (1.0 + 3.0 * v + 2.0 * (2.0 * (v * v + v)).sqrt()) / 16.0;
                let next = 0.25 * (1.0 - v);
                let middle = 0.5 * (1.0 + v) - 2.0 * outer;
                halves(&[outer, next * half, middle * half.powi(2), next * half.powi(3), outer * half.powi(4)])
            }
            ShaperKind::TwoHumpEi => fitted(&TWO_HUMP_EI, damping, 1.0 / frequency_hz),
            ShaperKind::ThreeHumpEi => fitted(&THREE_HUMP_EI, damping, 1.0 / frequency_hz),
        };
        let sum: f64 = pairs.iter().map(|(weight, _)| weight).sum();
        let impulses = pairs.into_iter().map(|(weight, delay_s)| Impulse { weight: weight / sum, delay_s }).collect();
        Ok(Self { impulses })
    }

    /// Returns the impulses.
    pub fn impulses(&self) -> &[Impulse] {
        &self.impulses
    }

    /// Returns the mean delay, s: the lag at constant speed.
    pub fn centroid_s(&self) -> f64 {
        self.impulses.iter().map(|one| one.weight * one.delay_s).sum()
    }

    /// Shifts the shaper in time so that constant speed passes without lag.
    pub fn centred(mut self) -> Self {
        let centroid_s = self.centroid_s();
        self.impulses.iter_mut().for_each(|one| one.delay_s -= centroid_s);
        self
    }

    /// Returns the time between the first and the last impulse, s.
    pub fn length_s(&self) -> f64 {
        match self.impulses.as_slice() {
            [first, .., last] => last.delay_s - first.delay_s,
            _ => 0.0,
        }
    }

    /// Returns the variance of the delays, s^2. An acceleration `a` displaces the shaped position
    /// by `a` times half the variance.
    pub fn variance_s2(&self) -> f64 {
        let centroid_s = self.centroid_s();
        self.impulses.iter().map(|one| one.weight * (one.delay_s - centroid_s).powi(2)).sum()
    }

    /// Returns the remaining vibration of a mode (undamped frequency, Hz, and damping ratio),
    /// relative to that of a single impulse at the time of the last one.
    pub fn residual(&self, frequency_hz: f64, damping: f64) -> f64 {
        let omega = TAU * frequency_hz;
        let damped = omega * (1.0 - damping * damping).sqrt();
        let last_s = self.impulses.last().map_or(0.0, |one| one.delay_s);
        let (mut sine, mut cosine) = (0.0, 0.0);
        for one in &self.impulses {
            let before_s = last_s - one.delay_s;
            let amplitude = one.weight * (-damping * omega * before_s).exp();
            sine += amplitude * (damped * before_s).sin();
            cosine += amplitude * (damped * before_s).cos();
        }
        sine.hypot(cosine)
    }
}

/// Returns EI by the published polynomials in the tolerated vibration `v` and the damping.
fn ei_with_damping(v: f64, damping: f64, period_s: f64) -> Vec<(f64, f64)> {
    let polynomial = |terms: [f64; 4]| terms.into_iter().rev().fold(0.0, |sum, term| sum * damping + term);
    let first = polynomial([0.24968 + 0.24961 * v, 0.80008 + 1.23328 * v, 0.49599 + 3.17316 * v, 0.0]);
    let last = polynomial([0.25149 + 0.21474 * v, -0.83249 + 1.41498 * v, 0.85181 - 4.90094 * v, 0.0]);
    let middle_periods =
        polynomial([0.4999, (0.46159 + 8.57843 * v) * v, (4.26169 - 108.644 * v) * v, (1.75601 + 336.989 * v) * v]);
    vec![(first, 0.0), (1.0 - first - last, middle_periods * period_s), (last, period_s)]
}

/// Coefficients, in rising powers of the damping ratio, of an impulse's weight and of its delay in
/// undamped periods.
type Fitted = ([f64; 4], [f64; 4]);

const TWO_HUMP_EI: [Fitted; 4] = [
    ([0.16054, 0.76699, 2.26560, -1.22750], [0.0; 4]),
    ([0.33911, 0.45081, -2.58080, 1.73650], [0.49890, 0.16270, -0.54262, 6.16180]),
    ([0.34089, -0.61533, -0.68765, 0.42261], [0.99748, 0.18382, -1.58270, 8.17120]),
    ([0.15997, -0.60246, 1.00280, -0.93145], [1.49920, -0.09297, -0.28338, 1.85710]),
];

const THREE_HUMP_EI: [Fitted; 5] = [
    ([0.11275, 0.76632, 3.29160, -1.44380], [0.0; 4]),
    ([0.23698, 0.61164, -2.57850, 4.85220], [0.49974, 0.23834, 0.44559, 12.4720]),
    ([0.30008, -0.19062, -2.14560, 0.13744], [0.99849, 0.29808, -2.36460, 23.3990]),
    ([0.23775, -0.73297, 0.46885, -2.08650], [1.49870, 0.10306, -2.01390, 17.0320]),
    ([0.11244, -0.45439, 0.96382, -1.46000], [1.99960, -0.28231, 0.61536, 5.40450]),
];

fn fitted(table: &[Fitted], damping: f64, undamped_period_s: f64) -> Vec<(f64, f64)> {
    let value = |terms: &[f64; 4]| terms.iter().rev().fold(0.0, |sum, term| sum * damping + term);
    table.iter().map(|(weight, delay)| (value(weight), value(delay) * undamped_period_s)).collect()
}
