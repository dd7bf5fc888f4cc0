//! Places of a motor's steps on a block's path.

use crate::piece::PieceEnd;
use crate::real::Real;
use crate::stretches::Stretch;

/// The steps of a motor in a stretch of a block.
#[derive(Clone, Copy, Debug)]
pub enum MotorSteps {
    /// Step k of N at (k - 1/2)/N of the stretch.
    Even {
        /// Number of steps.
        count: u32,
    },
    /// Places given by the travel, in 1/256 steps.
    Extruder {
        /// Travel in the stretch, either way.
        whole: u32,
        /// Travel up to the first step.
        first: u32,
        /// Number of steps.
        count: u32,
    },
}

/// The part of a block's path that a stretch is, in units of 10 nm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span<F> {
    /// Path from the block's start to its own.
    before: F,
    /// Length of the part.
    length: F,
    /// Reciprocal of the length.
    per_length: F,
    /// Path from its end to the block's. Not a difference of long lengths: where the block ends at
    /// standstill, a hair of path takes long.
    after: F,
}

impl<F: Real> Span<F> {
    /// All of a block of this length.
    #[inline(always)]
    pub(crate) fn whole(length: F, per_length: F) -> Self {
        Self { before: F::ZERO, length, per_length, after: F::ZERO }
    }

    /// A stretch of a block of this length.
    #[inline(always)]
    pub(crate) fn of(stretch: &Stretch, length: F, per_length: F) -> Self {
        if stretch.before_10nm == 0 && stretch.after_10nm == 0 {
            return Self::whole(length, per_length);
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

/// Places of one motor's steps on a block's path, in units of 10 nm.
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
    /// Reciprocal of the spacing.
    pub(crate) per_spacing: F,
}

impl<F: Real> Spacing<F> {
    /// Path from the block's start to a step.
    #[inline]
    pub(crate) fn position(&self, index: u32) -> F {
        self.first + F::from_u32(index) * self.spacing
    }

    /// Path from a step to the block's end.
    #[inline]
    pub(crate) fn rest(&self, index: u32) -> F {
        self.after_last + F::from_u32((self.count.saturating_sub(1)).saturating_sub(index)) * self.spacing
    }

    /// Steps up to and including the end of a piece, of which `done` are in those before it.
    #[inline]
    pub(crate) fn steps_up_to(&self, end: PieceEnd<F>, done: u32) -> u32 {
        // The first step in a length, and as many as spacings fit after it. Casts saturate.
        let fitting = |length: F| (length * self.per_spacing + F::from_u32(1)).to_u32();
        match end {
            PieceEnd::FromStart(end) => fitting(end - self.first).min(self.count),
            PieceEnd::ToEnd(rest) => {
                let left = self.count.saturating_sub(done);
                self.count.saturating_sub(fitting(rest - self.after_last).min(left))
            }
            PieceEnd::Last => self.count,
        }
    }

    /// Spacing of a motor's steps.
    #[inline]
    pub(crate) fn new(span: &Span<F>, steps: &MotorSteps) -> Self {
        match *steps {
            MotorSteps::Even { count } => {
                let parts = F::from_u32(count.max(1));
                let spacing = span.length / parts;
                let half = F::constant(0.5) * spacing;
                Self {
                    count,
                    first: span.before + half,
                    after_last: span.after + half,
                    spacing,
                    per_spacing: parts * span.per_length,
                }
            }
            MotorSteps::Extruder { whole, first, count } => {
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
    }
}
