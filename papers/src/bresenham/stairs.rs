//! Stairs of a line of two axes.

use super::widths::{FromQuotient, Widths};
use ferrostep_planner::bresenham::Slope;

/// Equal steps of a line, except for the last step if the stair is whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stair {
    /// Steps of the major axis, at least 1.
    pub width: u32,
    /// True if the last step is of the rarer kind: with the minor axis or, on a steep line, without
    /// it ([`Slope::is_steep`]). False for the remainder after the last stair.
    pub is_whole: bool,
}

/// Stairs of a line, and the remainder after the last: at most min(dy, dx - dy) + 1.
#[derive(Clone, Copy, Debug)]
pub struct Stairs<W = FromQuotient> {
    widths: W,
    /// Number of remaining whole stairs.
    whole: u32,
    /// Number of remaining steps.
    steps: u32,
}

impl<W: Widths> Stairs<W> {
    /// Creates the state at the start of a line.
    #[inline(always)]
    pub fn new(slope: Slope) -> Self {
        Self { widths: W::new(slope), whole: slope.rarer() as u32, steps: slope.major() }
    }

    /// Number of remaining whole stairs.
    #[inline(always)]
    pub fn whole(&self) -> u32 {
        self.whole
    }

    /// Width of the next whole stair. The caller must ensure that there is one: beyond
    /// [`Self::whole`] the value is meaningless.
    #[inline(always)]
    pub fn whole_width(&mut self) -> u32 {
        self.whole = self.whole.wrapping_sub(1);
        let width = self.widths.width();
        self.steps = self.steps.wrapping_sub(width);
        width
    }

    /// Number of steps after the last whole stair, once all whole stairs were handed out.
    #[inline(always)]
    pub fn rest(&self) -> u32 {
        self.steps
    }

    /// Number of decision values compared so far.
    pub fn decisions(&self) -> u64 {
        self.widths.decisions()
    }
}

impl<W: Widths> Iterator for Stairs<W> {
    type Item = Stair;

    #[inline(always)]
    fn next(&mut self) -> Option<Stair> {
        if self.whole > 0 {
            return Some(Stair { width: self.whole_width(), is_whole: true });
        }
        let width = core::mem::take(&mut self.steps);
        (width > 0).then_some(Stair { width, is_whole: false })
    }
}
