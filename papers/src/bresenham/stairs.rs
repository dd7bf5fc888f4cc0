//! A line of two axes, stair by stair.

use super::widths::{FromQuotient, Widths};
use ferrostep_planner::bresenham::Slope;

/// Equal steps of a line, except the last where the stair is whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stair {
    /// Steps of the major axis, at least 1.
    pub width: u32,
    /// True if its last step is of the rarer kind: with the minor axis, or without it on a steep
    /// line ([`Slope::is_steep`]). False for the remainder after the last stair.
    pub is_whole: bool,
}

/// A line's stairs, and the remainder after the last: at most min(dy, dx - dy) + 1.
#[derive(Clone, Copy, Debug)]
pub struct Stairs<W = FromQuotient> {
    widths: W,
    /// Whole stairs to come.
    whole: u32,
    /// Steps to come.
    steps: u32,
}

impl<W: Widths> Stairs<W> {
    /// New at the start of a line.
    #[inline(always)]
    pub fn new(slope: Slope) -> Self {
        Self { widths: W::new(slope), whole: slope.rarer() as u32, steps: slope.major() }
    }

    /// Whole stairs to come.
    #[inline(always)]
    pub fn whole(&self) -> u32 {
        self.whole
    }

    /// The width of the next whole stair, for those who count that there is one: beyond
    /// [`Self::whole`] it means nothing.
    #[inline(always)]
    pub fn whole_width(&mut self) -> u32 {
        self.whole = self.whole.wrapping_sub(1);
        let width = self.widths.width();
        self.steps = self.steps.wrapping_sub(width);
        width
    }

    /// Steps after the last whole stair, once all of these were handed out.
    #[inline(always)]
    pub fn rest(&self) -> u32 {
        self.steps
    }

    /// Decision values compared so far.
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
