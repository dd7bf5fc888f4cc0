//! The unit in which times within a block are counted, 2^-16 tick, and what path and
//! speed make of it.
//!
//! Path is in units of 10 nm, speed in units of 2^-16 mm/s.

use crate::kinematics::UNITS_PER_MM;
use crate::real::Real;

/// Frequency of the nominal time base, in ticks a second.
///
/// Every planned time is a number of these ticks. A board whose timer runs at another frequency
/// stretches time; it never plans other ticks.
pub const TICKS_PER_SECOND: u32 = 84_000_000;

/// Bits of fraction in a time unit: it is 2^-16 tick.
pub const FRACTION_BITS: u32 = 16;

/// Half a tick, in time units: added before the fraction is cut, it rounds.
pub const HALF_TICK: u64 = 1 << (FRACTION_BITS - 1);

/// Time units in a second.
pub const UNITS_PER_SECOND: f64 = TICKS_PER_SECOND as f64 * (1u64 << FRACTION_BITS) as f64;

/// Ticks that one unit of path takes at one unit of speed.
pub(crate) const TICKS: f64 = 65_536.0 * TICKS_PER_SECOND as f64 / UNITS_PER_MM as f64;

/// Time units that one unit of path takes at one unit of speed.
pub(crate) const UNITS: f64 = TICKS * (1u64 << FRACTION_BITS) as f64;

/// Time for a length at a constant speed.
#[inline]
pub(crate) fn cruise_time<F: Real>(length: F, speed: F) -> F {
    F::constant(UNITS) * length / speed
}

/// Time for a length between two speeds. 2X/(v1 + v2) has no division by a small difference.
#[inline]
pub(crate) fn ramp_time<F: Real>(length: F, from: F, to: F) -> F {
    if length > F::ZERO { F::constant(2.0 * UNITS) * length / (from + to) } else { F::ZERO }
}

/// Steps a tick for a unit of speed, at `per_spacing` steps a unit of length.
#[inline]
pub(crate) fn steps_per_tick<F: Real>(per_spacing: F) -> F {
    per_spacing * F::constant(1.0 / TICKS)
}
