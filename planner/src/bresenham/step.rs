//! Step ("staircase") Bresenham as the interpolator uses it: one division when a width is
//! requested.

use super::slope::Slope;

/// A line, walked by stairs: runs of major-axis steps, the last of each with a minor-axis step.
///
/// The points are those of classic Bresenham (Wu 2024, eq. 3).
#[derive(Clone, Copy, Debug)]
pub struct StepBresenham {
    /// 2 dy, by which the decision value rises with each step.
    rise: i32,
    /// 2 dx, by which the decision value falls where the minor axis steps.
    fall: i32,
    /// Decision value of the last step, at most zero: the minor axis steps when it would be
    /// positive.
    decision: i32,
}

impl StepBresenham {
    /// Line of `major` by `minor` steps; `None` unless `minor <= major <=` [`super::MAX_STEPS`].
    pub const fn new(major: u32, minor: u32) -> Option<Self> {
        match Slope::new(major, minor) {
            Ok(slope) => Some(Self { rise: 2 * slope.dy(), fall: 2 * slope.dx(), decision: -slope.dx() }),
            Err(_) => None,
        }
    }

    /// A line that never steps its minor axis.
    pub const fn level() -> Self {
        Self { rise: 0, fall: 0, decision: 0 }
    }

    /// Major-axis steps left in the present stair, up to and including the next one with a
    /// minor-axis step; a huge number after the last.
    #[inline]
    pub const fn width(&self) -> u32 {
        if self.rise == 0 {
            return u32::MAX;
        }
        // Neither term is negative.
        (self.decision.wrapping_neg() as u32 / self.rise as u32).wrapping_add(1)
    }

    /// Passes `count` major-axis steps, at most [`Self::width`]; returns true if the minor axis
    /// steps with the last of them.
    #[inline(always)]
    pub const fn pass(&mut self, count: u32) -> bool {
        // The sum is at most `rise`, which fits, as `count` is at most the width.
        self.decision = self.decision.wrapping_add(self.rise.wrapping_mul(count as i32));
        let steps = self.decision > 0;
        if steps {
            self.decision = self.decision.wrapping_sub(self.fall);
        }
        steps
    }

    /// Number of consecutive major-axis steps, from the next one on, that the minor axis joins; a
    /// huge number if it joins all. This is the complement of a stair: on a line steeper than 1/2
    /// most steps are joint.
    #[inline]
    pub const fn diagonal(&self) -> u32 {
        let above = self.decision.wrapping_add(self.rise);
        if above <= 0 {
            return 0;
        }
        if self.fall == self.rise {
            return u32::MAX;
        }
        // Each step lowers the decision value by this much; neither term is negative.
        let step = self.fall.wrapping_sub(self.rise) as u32;
        ((above - 1) as u32 / step).wrapping_add(1)
    }

    /// Passes `count` major-axis steps, at most [`Self::diagonal`].
    #[inline(always)]
    pub const fn pass_diagonal(&mut self, count: u32) {
        self.decision = self.decision.wrapping_add(self.rise.wrapping_sub(self.fall).wrapping_mul(count as i32));
    }
}
