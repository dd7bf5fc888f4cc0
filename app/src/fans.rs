//! The planner task's demand for the fans, as the heaters' task takes it.

use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use ferrostep_hal_shim::FanOutput;
use ferrostep_printer::FanDemand;

/// The demand between two tasks. Each fan is by itself, so that it does not matter when one is
/// seen before another.
pub struct SharedDemand {
    powers: [AtomicU8; FanOutput::COUNT],
    motors_on: AtomicBool,
}

impl SharedDemand {
    /// Demand of fans that are all off.
    pub const fn new() -> Self {
        Self { powers: [const { AtomicU8::new(0) }; FanOutput::COUNT], motors_on: AtomicBool::new(false) }
    }

    /// Sets it.
    pub fn store(&self, demand: &FanDemand) {
        for (shared, power) in self.powers.iter().zip(demand.powers) {
            shared.store(power, Ordering::Relaxed);
        }
        self.motors_on.store(demand.motors_on, Ordering::Relaxed);
    }

    /// Reads it.
    pub fn load(&self) -> FanDemand {
        FanDemand {
            powers: self.powers.each_ref().map(|power| power.load(Ordering::Relaxed)),
            motors_on: self.motors_on.load(Ordering::Relaxed),
        }
    }
}
