//! The pace of a bus that software moves.

/// The pace of a bus. A type without fields needs no memory.
pub trait BusPace {
    /// Shortest time that half of a clock's period lasts, ns.
    const HALF_PERIOD_NS: u32;
    /// Waits for half of a period.
    fn half_period(&mut self);
}
