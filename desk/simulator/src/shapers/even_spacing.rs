//! General form of MZV: any number of impulses at equal distances.

use std::f64::consts::TAU;
use std::fmt;

/// Maximum number of impulses, as in Klipper.
const MAX_IMPULSES: usize = 10;

/// Magnitude of weights that are rounding errors of zero; a weight below its negative value counts
/// as negative.
const WEIGHT_ROUNDING: f64 = 1e-5;

/// Norm below which what is left of a row counts as dependent on the rows before it.
const DEPENDENT_ROW: f64 = 1e-9;

/// Number and spacing of impulses that leave no vibration at the undamped frequency and at the next
/// zeros above it.
///
/// With `n` impulses over `t` periods the response is zero at `1 + i / tau` times the frequency,
/// for `i` from 0 to `n - 2`, where `tau = t (n - 2) / (n - 2 t - 1)`; of all such weights, those
/// with the least sum of squares are chosen. Three impulses over three quarters of a period are
/// MZV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvenSpacing {
    weights: [f64; MAX_IMPULSES],
    count: usize,
    periods: f64,
}

/// Reason why no shaper with this spacing exists.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EvenSpacingError {
    /// The number of impulses is not within 3 to 10.
    Count(usize),
    /// The time, in periods, is not positive, or is too long for the number of impulses.
    Length {
        /// Time asked for, periods.
        periods: f64,
        /// Limit below which the time must be, periods.
        limit: f64,
    },
    /// A weight would be negative.
    Negative,
}

impl fmt::Display for EvenSpacingError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(count) => write!(out, "{count} impulses, expected 3 to {MAX_IMPULSES}"),
            Self::Length { periods, limit } => {
                write!(out, "{periods} periods, expected more than 0 and less than {limit} for so many impulses")
            }
            Self::Negative => write!(out, "an impulse would be negative: choose another number of impulses or periods"),
        }
    }
}

impl std::error::Error for EvenSpacingError {}

impl EvenSpacing {
    /// Spaces `count` impulses over `periods` damped periods.
    ///
    /// # Errors
    /// The count or the time is out of range, or a weight would be negative.
    pub fn new(count: usize, periods: f64) -> Result<Self, EvenSpacingError> {
        if !(3..=MAX_IMPULSES).contains(&count) {
            return Err(EvenSpacingError::Count(count));
        }
        let n = count as f64;
        let limit = 0.5 * (n - 1.0);
        // Close to the limit the zeros move towards infinity.
        if !(periods > 0.0 && periods < limit - 1e-7) {
            return Err(EvenSpacingError::Length { periods, limit });
        }
        let zeros_apart = (n - 2.0 * periods - 1.0) / (periods * (n - 2.0));
        let delays: Vec<f64> = (0..count).map(|index| index as f64 * periods / (n - 1.0)).collect();
        let mut rows = vec![(vec![1.0; count], 1.0)];
        for zero in 0..count - 1 {
            let angles: Vec<f64> = delays.iter().map(|delay| TAU * (1.0 + zero as f64 * zeros_apart) * delay).collect();
            rows.push((angles.iter().map(|angle| angle.cos()).collect(), 0.0));
            rows.push((angles.iter().map(|angle| angle.sin()).collect(), 0.0));
        }
        let mut weights = [0.0; MAX_IMPULSES];
        for (weight, value) in weights.iter_mut().zip(least_norm(&rows, count)) {
            if value < -WEIGHT_ROUNDING {
                return Err(EvenSpacingError::Negative);
            }
            *weight = value;
        }
        Ok(Self { weights, count, periods })
    }

    /// Returns the weights without damping.
    pub fn weights(&self) -> &[f64] {
        &self.weights[..self.count]
    }

    /// Returns the distance between two impulses, in damped periods.
    pub fn step_periods(&self) -> f64 {
        self.periods / (self.count as f64 - 1.0)
    }

    /// Returns the number of impulses and the damped periods that they cover.
    pub const fn shape(&self) -> (usize, f64) {
        (self.count, self.periods)
    }
}

/// Returns the shortest vector whose products with the rows are the rows' values; rows may depend
/// on each other.
fn least_norm(rows: &[(Vec<f64>, f64)], length: usize) -> Vec<f64> {
    let mut basis: Vec<(Vec<f64>, f64)> = Vec::new();
    let mut solution = vec![0.0; length];
    for (row, value) in rows {
        let (mut rest, mut rest_value) = (row.clone(), *value);
        // Subtract twice: once loses digits where rows are nearly parallel.
        for _ in 0..2 {
            for (unit, unit_value) in &basis {
                let part: f64 = rest.iter().zip(unit).map(|(a, b)| a * b).sum();
                rest.iter_mut().zip(unit).for_each(|(a, b)| *a -= part * b);
                rest_value -= part * unit_value;
            }
        }
        let norm = rest.iter().map(|a| a * a).sum::<f64>().sqrt();
        if norm < DEPENDENT_ROW {
            continue;
        }
        rest.iter_mut().for_each(|a| *a /= norm);
        rest_value /= norm;
        solution.iter_mut().zip(&rest).for_each(|(sum, a)| *sum += rest_value * a);
        basis.push((rest, rest_value));
    }
    solution
}
