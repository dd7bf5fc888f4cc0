//! Steps at a constant interval.

use crate::real::Real;
use crate::time_units::{FRACTION_BITS, HALF_TICK};

/// A constant interval between steps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EvenSteps {
    /// The interval, in time units.
    pub(crate) interval: u64,
    /// Fraction of the interval, in 2^-16 time units: over millions of steps it adds up.
    pub(crate) beyond: u16,
    /// The interval in whole ticks, the nearest.
    pub(crate) ticks: u32,
    /// Excess of whole ticks over the interval, in time units.
    pub(crate) drift: i32,
    /// Longest run of steps at whole ticks that adds up to at most [`STAIR_DRIFT`] and
    /// [`MAX_STAIR_TICKS`]; at least 1.
    pub(crate) longest_stair: u32,
}

/// Maximum error of a stair whose one interval is a whole number of ticks, in time units:
/// 31 ticks, 0.4 us.
const STAIR_DRIFT: u32 = 31 << FRACTION_BITS;

/// Maximum number of steps of a stair: the players' slots hold as many.
const MAX_STAIR_STEPS: u32 = 1 << 13;

/// Maximum number of ticks from a stair's first step to its last, some 25 s: with an interval more,
/// they are still a 32-bit number.
const MAX_STAIR_TICKS: u32 = 1 << 31;

impl EvenSteps {
    /// No steps.
    pub(super) const EMPTY: Self = Self { interval: 0, beyond: 0, ticks: 0, drift: 0, longest_stair: 0 };

    /// Steps at an interval in time units, cut to 2^-16 of one.
    #[inline]
    pub(super) fn new<F: Real>(interval: F) -> Self {
        let beyond = (interval * F::from_u32(1 << 16)).to_u64() as u16;
        let interval = interval.to_u64();
        let rounded = interval.saturating_add(HALF_TICK) >> FRACTION_BITS;
        let ticks = rounded as u32;
        // The drift is at most half a tick.
        let drift = (ticks << FRACTION_BITS).wrapping_sub(interval as u32) as i32;
        let longest = if rounded > u64::from(u32::MAX) {
            1
        } else {
            (STAIR_DRIFT / drift.unsigned_abs().max(1)).min(MAX_STAIR_TICKS / ticks.max(1)).max(1)
        };
        Self { interval, beyond, ticks, drift, longest_stair: longest.min(MAX_STAIR_STEPS) }
    }
}
