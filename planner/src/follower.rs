//! A motor that steps with some of the master's steps.

use crate::bresenham::StepBresenham;

/// A motor that follows the master by step Bresenham.
#[derive(Clone, Copy, Debug)]
pub struct Follower {
    bit: u8,
    line: StepBresenham,
}

impl Follower {
    /// A motor that never steps.
    pub const NONE: Self = Self { bit: 0, line: StepBresenham::level() };

    /// The motor of this bit, which makes `steps` along with `master_steps` of the master.
    #[inline]
    pub fn new(bit: u8, master_steps: u32, steps: u32) -> Self {
        Self { bit, line: StepBresenham::new(master_steps, steps).unwrap_or(StepBresenham::level()) }
    }

    /// The motor's bit.
    pub fn bit(&self) -> u8 {
        self.bit
    }

    /// The motor's line.
    pub fn line(&self) -> StepBresenham {
        self.line
    }

    /// Takes over the line's state after it was passed.
    pub fn set_line(&mut self, line: StepBresenham) {
        self.line = line;
    }

    /// Master steps up to and including the next common one; a huge number after the last.
    #[inline]
    pub fn until(&self) -> u32 {
        self.line.width()
    }

    /// Passes `count` master steps, at most [`Self::until`]; returns the motor's bit if it steps
    /// with the last of them.
    // R1.
    #[inline(always)]
    pub fn pass(&mut self, count: u32) -> u8 {
        if self.line.pass(count) { self.bit } else { 0 }
    }
}
