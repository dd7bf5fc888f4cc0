//! Virtual time in cycles of the core, and the cost of work.

use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_virtual_board::CYCLES_A_TICK;

/// Cycles of the core in a second.
pub const CYCLES_PER_S: u64 = TICKS_PER_SECOND as u64 * CYCLES_A_TICK;

/// Cycles in a millisecond.
pub const CYCLES_A_MS: u64 = CYCLES_PER_S / 1_000;

/// Cycles in a microsecond.
pub const CYCLES_A_US: u64 = CYCLES_PER_S / 1_000_000;

/// The nanosecond that contains the start of a cycle.
pub(super) fn to_ns(cycle: u64) -> u64 {
    (u128::from(cycle) * 1_000_000_000 / u128::from(CYCLES_PER_S)) as u64
}

/// The first cycle at which a nanosecond is over.
pub(super) fn from_ns(ns: u64) -> u64 {
    (u128::from(ns) * u128::from(CYCLES_PER_S)).div_ceil(1_000_000_000) as u64
}

/// The cost of work, cycles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Costs {
    /// A line, from its text to its move in look-ahead; the planner task comes in between.
    pub line: u64,
    /// A move on its way through the planner task.
    pub planned_move: u64,
    /// An entry for the step queue.
    pub entry: u64,
    /// The planner task takes this many times longer from this cycle on.
    pub slower_planner: (u64, u64),
}

impl Costs {
    /// Costs of a board of 168 MHz, roughly: 7000 instructions a move at 1.4 cycles, two thirds of
    /// them for the line, and 90 an event (`ferrostep_printer::DEFAULT_MOVES_PER_S`,
    /// `DEFAULT_EVENTS_PER_S`).
    pub const BOARD: Self = Self { line: 6_600, planned_move: 3_200, entry: 126, slower_planner: (1, 0) };

    /// The same with a planner task this many times slower from a millisecond on.
    pub const fn with_slower_planner(self, times: u64, from_ms: u64) -> Self {
        Self { slower_planner: (times, from_ms * CYCLES_A_MS), ..self }
    }

    /// Factor by which the planner task is slower at a cycle.
    pub(super) fn slowness_at(&self, now: u64) -> u64 {
        let (times, from) = self.slower_planner;
        if now >= from { times } else { 1 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_is_over_at_the_cycle_that_ends_it() {
        for ns in [0, 1, 5, 6, 999_999, 1_000_000, 86_400_000_000_000] {
            assert!(to_ns(from_ns(ns)) >= ns);
            assert!(from_ns(ns) == 0 || to_ns(from_ns(ns) - 1) < ns);
        }
    }
}
