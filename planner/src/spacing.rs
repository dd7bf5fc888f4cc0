//! Where on a block's path the steps of a motor are.

use crate::block_law::BlockLaw;
use crate::inner_ends::Stretch;
use crate::real::Real;

/// How the extruder's steps lie in a stretch, in 1/256 steps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExtruderTravel {
    /// Travel in the stretch, either way.
    pub(crate) whole: u32,
    /// Travel up to the first step.
    pub(crate) first: u32,
    /// Number of steps.
    pub(crate) count: u32,
}

/// The part of a block's path that a stretch is, in units of 10 nm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span<F> {
    /// Path from the block's start to its own.
    before: F,
    /// Its length.
    length: F,
    /// The reciprocal of its length.
    per_length: F,
    /// Path from its end to the block's. Not a difference of long lengths: where the block ends at standstill, a hair of
    /// path takes long.
    after: F,
}

impl<F: Real> Span<F> {
    /// All of a block.
    #[inline(always)]
    pub(crate) fn whole(law: &impl BlockLaw<F>) -> Self {
        Self { before: F::ZERO, length: law.length(), per_length: law.per_length(), after: F::ZERO }
    }

    /// A stretch of a block.
    #[inline(always)]
    pub(crate) fn of(stretch: &Stretch, law: &impl BlockLaw<F>) -> Self {
        if stretch.before_10nm == 0 && stretch.after_10nm == 0 {
            return Self::whole(law);
        }
        let length = F::from_u32(stretch.length_10nm);
        Self {
            before: F::from_u32(stretch.before_10nm),
            length,
            per_length: F::from_u32(1) / length,
            after: F::from_u32(stretch.after_10nm),
        }
    }
}

/// Where the steps of one motor are on a block's path, in units of 10 nm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spacing<F> {
    /// Number of steps.
    pub(crate) count: u32,
    /// Path length from the block's start to the first.
    pub(crate) first: F,
    /// Path length from the last to the block's end.
    pub(crate) after_last: F,
    /// Path length from one to the next.
    pub(crate) spacing: F,
    /// Its reciprocal.
    pub(crate) per_spacing: F,
}

impl<F: Real> Spacing<F> {
    /// The master's: its step k of N is at (k - 1/2) S/N of the stretch.
    #[inline]
    pub(crate) fn of_master(span: &Span<F>, count: u32) -> Self {
        let steps = F::from_u32(count.max(1));
        let spacing = span.length / steps;
        let half = F::constant(0.5) * spacing;
        Self {
            count,
            first: span.before + half,
            after_last: span.after + half,
            spacing,
            per_spacing: steps * span.per_length,
        }
    }

    /// The extruder's, which steps where its own travel says.
    #[inline]
    pub(crate) fn of_extruder(span: &Span<F>, travel: &ExtruderTravel) -> Self {
        let &ExtruderTravel { whole, first, count } = travel;
        let last = first.saturating_add(count.saturating_sub(1).saturating_mul(256));
        let parts = F::from_u32(whole.max(1));
        let per_256th = span.length / parts;
        Self {
            count,
            first: span.before + F::from_u32(first) * per_256th,
            after_last: span.after + F::from_u32(whole.saturating_sub(last)) * per_256th,
            spacing: F::from_u32(256) * per_256th,
            per_spacing: parts * F::constant(1.0 / 256.0) * span.per_length,
        }
    }
}
