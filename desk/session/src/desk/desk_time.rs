//! Virtual time: it follows the motion, and otherwise passes only on request.

use std::cell::Cell;

use ferrostep_planner::TICKS_PER_SECOND;

/// Time by the motion clock, and the time during which that stood still.
#[derive(Debug, Default)]
pub struct DeskTime {
    idle_ns: Cell<u64>,
}

impl DeskTime {
    /// Now, when the motion clock shows a tick.
    pub fn now_ns(&self, tick: u64) -> u64 {
        self.idle_ns.get() + motion_ns(tick)
    }

    /// Advances time to a moment, unless it is past, while the motion clock stays at a tick.
    pub fn wait_until(&self, tick: u64, wake_ns: u64) {
        self.idle_ns.set(self.idle_ns.get() + wake_ns.saturating_sub(self.now_ns(tick)));
    }
}

/// Ticks of the motion clock in nanoseconds.
pub fn motion_ns(ticks: u64) -> u64 {
    // Whole seconds apart, so that no product leaves 64 bits.
    let a_second = u64::from(TICKS_PER_SECOND);
    ticks / a_second * 1_000_000_000 + ticks % a_second * 1_000_000_000 / a_second
}

/// Whole ticks of the motion clock in nanoseconds.
pub fn motion_ticks(ns: u64) -> u64 {
    let a_second = u64::from(TICKS_PER_SECOND);
    ns / 1_000_000_000 * a_second + ns % 1_000_000_000 * a_second / 1_000_000_000
}
