//! The signal that the supply is failing, polled by the planner task every 2 ms.

use ferrostep_printer::{Signals, SupplyWatch};
use ferrostep_stm32f4_board::board::is_triggered;

use crate::profile::PROFILE;
use crate::wiring::POWER_LOSS;

/// Watch of the supply signal, on machines that have one.
pub struct Supply(SupplyWatch);

impl Supply {
    /// Creates the watch before the first reading.
    pub const fn new() -> Self {
        Self(SupplyWatch::new())
    }

    /// Returns true if the supply has just failed. The millisecond clock may wrap.
    pub fn has_failed(&mut self, now_ms: u32, signals: &Signals) -> bool {
        match (POWER_LOSS, &PROFILE.supply_signal) {
            (Some(pin), Some(signal)) => self.0.look(now_ms, is_triggered(pin), signal, signals),
            _ => false,
        }
    }
}
