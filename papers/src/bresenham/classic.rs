//! Classic Bresenham: one decision per step.

use super::decisions::{Decisions, Uncounted};
use ferrostep_planner::bresenham::Slope;

/// A line walked step by step along its major axis (Wu 2024, eq. 3).
#[derive(Clone, Copy, Debug)]
pub struct Classic<D = Uncounted> {
    /// 2 dy, by which the decision value rises if the major axis steps alone.
    rise: i32,
    /// 2 (dy - dx), not above zero, by which the decision value changes if both axes step.
    fall: i32,
    /// Decision value of the next step.
    decision: i32,
    decisions: D,
}

impl<D: Decisions> Classic<D> {
    /// Creates the state at the start of a line.
    #[inline]
    pub fn new(slope: Slope) -> Self {
        let (dx, dy) = (slope.dx(), slope.dy());
        let (rise, fall) = (dy.wrapping_mul(2), dy.wrapping_sub(dx).wrapping_mul(2));
        Self { rise, fall, decision: rise.wrapping_sub(dx), decisions: D::default() }
    }

    /// Passes `count` steps of the major axis with one decision each; returns true if the minor
    /// axis steps with the last of them.
    ///
    /// The decision value stays within 2 dx of zero, however many steps are passed.
    #[inline(always)]
    pub fn pass(&mut self, count: u32) -> bool {
        let mut steps = false;
        for _ in 0..count {
            steps = self.decisions.is_above_zero(self.decision);
            self.decision = self.decision.wrapping_add(if steps { self.fall } else { self.rise });
        }
        steps
    }

    /// Number of decisions so far.
    pub fn decisions(&self) -> u64 {
        self.decisions.count()
    }
}
