//! Bounds of the values that commands set.

use crate::error::CommandError;

/// Marlin's full power, in whose units G-code has the gains.
pub(crate) const FULL_POWER: f64 = 255.0;

/// Farthest offset of a nozzle, either way, units of 10 nm.
pub(crate) const LARGEST_OFFSET_10NM: i64 = 20_000_000;

/// Largest offset of a homed axis, either sign, mm.
pub(crate) const LARGEST_MM: f64 = 1000.0;

/// Smallest and largest speed and acceleration that may be set, mm/s and mm/s^2.
pub(crate) const SMALLEST_LIMIT: f64 = 0.01;
pub(crate) const LARGEST_LIMIT: f64 = 1_000_000.0;

/// Smallest and largest percentage of feed and flow.
pub(crate) const PERCENTS: [f64; 2] = [1.0, 999.0];

/// A length within its range, both in units of 10 nm.
pub(crate) fn within(word: char, length_10nm: i64, minimum_10nm: i64, maximum_10nm: i64) -> Result<i64, CommandError> {
    if (minimum_10nm..=maximum_10nm).contains(&length_10nm) {
        return Ok(length_10nm);
    }
    let [value, minimum, maximum] = [length_10nm, minimum_10nm, maximum_10nm].map(|units| units as f64 / 100_000.0);
    Err(CommandError::OutOfRange { word, value, minimum, maximum })
}

/// A value within its range.
pub(crate) fn in_range(word: char, value: f64, minimum: f64, maximum: f64) -> Result<f64, CommandError> {
    if value >= minimum && value <= maximum {
        Ok(value)
    } else {
        Err(CommandError::OutOfRange { word, value, minimum, maximum })
    }
}
