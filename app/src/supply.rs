//! The signal that the supply fails, for the planner task, which looks every 2 ms.

use ferrostep_printer::{Signals, SupplyWatch};
use ferrostep_stm32f4_board::board::is_triggered;

use crate::profile::PROFILE;
use crate::wiring::POWER_LOSS;

/// Looks at the signal, on a machine that has one.
pub struct Supply(SupplyWatch);

impl Supply {
    /// The signal has not been read yet.
    pub const fn new() -> Self {
        Self(SupplyWatch::new())
    }

    /// True if the supply has just failed. To be called with a clock of milliseconds that may wrap.
    pub fn has_failed(&mut self, now_ms: u32, signals: &Signals) -> bool {
        match (POWER_LOSS, &PROFILE.supply_signal) {
            (Some(pin), Some(signal)) => self.0.look(now_ms, is_triggered(pin), signal, signals),
            _ => false,
        }
    }
}
