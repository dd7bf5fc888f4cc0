//! Counts of comparisons of decision values with zero: the work that Wu 2024 saves.

/// Comparison of decision values, optionally counted. All comparisons of an algorithm go through
/// this trait, so that none is left out.
pub trait Decisions: Copy + Default {
    /// True if a decision value is above zero.
    fn is_above_zero(&mut self, value: i32) -> bool;

    /// Number of comparisons so far.
    fn count(&self) -> u64;
}

/// A comparison without a count, at no cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Uncounted;

impl Decisions for Uncounted {
    #[inline(always)]
    fn is_above_zero(&mut self, value: i32) -> bool {
        value > 0
    }

    /// Always 0.
    fn count(&self) -> u64 {
        0
    }
}

/// A comparison with a count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counted(u64);

impl Decisions for Counted {
    #[inline]
    fn is_above_zero(&mut self, value: i32) -> bool {
        self.0 = self.0.wrapping_add(1);
        value > 0
    }

    fn count(&self) -> u64 {
        self.0
    }
}
