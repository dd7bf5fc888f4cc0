//! Definitions that several tables share: the axes' names, their speeds and their travel.

use ferrostep_checked_toml::{Range, range};

/// Units of 10 nm in a mm.
const UNITS_PER_MM: f64 = 100_000.0;

pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];
pub(crate) const MOTORS: [&str; 4] = ["x", "y", "z", "e"];

pub(crate) const FEED: Range = range(0.01, 2_000.0, "mm/s");

/// Ends of the travel of X, Y and Z, mm.
pub(crate) struct Travel {
    /// Lower ends, at most 0.
    pub lower_mm: [f64; 3],
    /// Upper ends.
    pub upper_mm: [f64; 3],
}

/// Millimetres to units of 10 nm. The keys' ranges keep the product far within both types.
pub(crate) fn units_10nm(length_mm: f64) -> i64 {
    (length_mm * UNITS_PER_MM).round() as i64
}
