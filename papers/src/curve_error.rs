//! Reasons for which numbers do not define an S-curve.

use core::fmt;

/// Minimum and maximum of nonzero numbers in a curve: beyond them squares and quotients would
/// overflow.
pub(crate) const LEAST: f64 = 1e-12;
pub(crate) const MOST: f64 = 1e12;

/// Returns true if a number that must not be zero is in range.
pub(crate) fn is_in_range(x: f64) -> bool {
    (LEAST..=MOST).contains(&x)
}

/// Returns true if a number that may be zero is zero or in range.
pub(crate) fn is_zero_or_in_range(x: f64) -> bool {
    x == 0.0 || is_in_range(x)
}

/// Reason for which no such S-curve exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CurveError {
    /// The jerk is outside 1e-12 to 1e12 or not a number.
    Jerk,
    /// The acceleration is below 1e-12 or not a number.
    Acceleration,
    /// A speed is neither zero nor in 1e-12 to 1e12, or all speeds are zero over a nonzero length.
    Speed,
    /// The length is neither zero nor in 1e-12 to 1e12.
    Length,
    /// The speeds at the ends are further apart than the length allows.
    TooShort,
    /// The start frequency is outside 1e-12 to 1e12 or not a number.
    StartFrequency,
    /// The highest frequency does not exceed the start frequency, or exceeds 1e12.
    TopFrequency,
    /// The table would exceed its maximum number of slices.
    TooManySlices,
}

impl fmt::Display for CurveError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Jerk => "the jerk must be a number from 1e-12 to 1e12",
            Self::Acceleration => "the acceleration must be a number from 1e-12 on",
            Self::Speed => "a speed must be zero or a number from 1e-12 to 1e12, and not all of them zero",
            Self::Length => "the length must be zero or a number from 1e-12 to 1e12",
            Self::TooShort => "the length is too short for the speeds at its ends",
            Self::StartFrequency => "the start frequency must be a number from 1e-12 to 1e12",
            Self::TopFrequency => "the highest frequency must be above the start frequency, and at most 1e12",
            Self::TooManySlices => "the table would have more than 65536 slices",
        })
    }
}

impl core::error::Error for CurveError {}
