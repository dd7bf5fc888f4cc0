//! The planner task's fan demand, for the heater task.

use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use ferrostep_hal_shim::FanOutput;
use ferrostep_printer::FanDemand;

/// Fan demand shared by two tasks. Each fan is independent, so it does not matter if one is seen
/// before another.
pub struct SharedDemand {
    powers: [AtomicU8; FanOutput::COUNT],
    motors_on: AtomicBool,
}

impl SharedDemand {
    /// Creates a demand with all fans off.
    pub const fn new() -> Self {
        Self { powers: [const { AtomicU8::new(0) }; FanOutput::COUNT], motors_on: AtomicBool::new(false) }
    }

    /// Stores the demand.
    pub fn store(&self, demand: &FanDemand) {
        for (shared, power) in self.powers.iter().zip(demand.powers) {
            shared.store(power, Ordering::Relaxed);
        }
        self.motors_on.store(demand.motors_on, Ordering::Relaxed);
    }

    /// Reads the demand.
    pub fn load(&self) -> FanDemand {
        FanDemand {
            powers: self.powers.each_ref().map(|power| power.load(Ordering::Relaxed)),
            motors_on: self.motors_on.load(Ordering::Relaxed),
        }
    }
}
