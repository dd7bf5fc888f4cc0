//! Where on a block's path the steps of a motor are.

use crate::block_law::BlockLaw;
use crate::real::Real;

/// How the extruder's steps lie in a block, in 1/256 steps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExtruderTravel {
    /// Travel in the block, either way.
    pub(crate) whole: u32,
    /// Travel up to the first step.
    pub(crate) first: u32,
    /// Number of steps.
    pub(crate) count: u32,
}

/// Where the steps of one motor are on a block's path, in units of 10 nm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spacing<F> {
    /// Number of steps.
    pub(crate) count: u32,
    /// Path length up to the first.
    pub(crate) first: F,
    /// Path length from the last to the block's end. Not a difference of long lengths: where the block ends at
    /// standstill, a hair of path takes long.
    pub(crate) after_last: F,
    /// Path length from one to the next.
    pub(crate) spacing: F,
    /// Its reciprocal.
    pub(crate) per_spacing: F,
}

impl<F: Real> Spacing<F> {
    /// The master's: its step k of N is at (k - 1/2) S/N.
    #[inline]
    pub(crate) fn of_master(law: &impl BlockLaw<F>, count: u32) -> Self {
        let steps = F::from_u32(count.max(1));
        let spacing = law.length() / steps;
        let half = F::constant(0.5) * spacing;
        Self { count, first: half, after_last: half, spacing, per_spacing: steps * law.per_length() }
    }

    /// The extruder's, which steps where its own travel says.
    #[inline]
    pub(crate) fn of_extruder(law: &impl BlockLaw<F>, travel: &ExtruderTravel) -> Self {
        let &ExtruderTravel { whole, first, count } = travel;
        let last = first.saturating_add(count.saturating_sub(1).saturating_mul(256));
        let parts = F::from_u32(whole.max(1));
        let per_256th = law.length() / parts;
        Self {
            count,
            first: F::from_u32(first) * per_256th,
            after_last: F::from_u32(whole.saturating_sub(last)) * per_256th,
            spacing: F::from_u32(256) * per_256th,
            per_spacing: parts * F::constant(1.0 / 256.0) * law.per_length(),
        }
    }
}
