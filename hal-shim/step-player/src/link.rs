//! The flags between planner task and step interrupt.

use super::shared_word::WordU8;

/// Flags between the tasks that make step entries or stop motion and the interrupt that plays the
/// entries.
#[derive(Debug)]
pub struct StepLink {
    run: WordU8,
    ran_dry: WordU8,
    /// Motion must stop; the interrupt reads this.
    stop: WordU8,
    /// True if a command or a fault asks for the stop, not only the sensor of a homing axis.
    requested: WordU8,
}

impl Default for StepLink {
    fn default() -> Self {
        Self::new()
    }
}

impl StepLink {
    /// Flags of a player at rest.
    pub const fn new() -> Self {
        Self { run: WordU8::new(0), ran_dry: WordU8::new(0), stop: WordU8::new(0), requested: WordU8::new(0) }
    }

    /// Makes the player take slots until the ring is empty.
    pub fn start(&self) {
        self.run.store(1);
    }

    /// Returns true if the player takes slots.
    #[inline(always)]
    pub fn is_running(&self) -> bool {
        self.run.load() != 0
    }

    /// Notes that the player has found no slot; it waits for [`Self::start`].
    #[inline(always)]
    pub fn run_dry(&self) {
        self.run.store(0);
        self.ran_dry.store(1);
    }

    /// Returns true if the player has found no slot since the last call.
    pub fn take_ran_dry(&self) -> bool {
        Self::take(&self.ran_dry)
    }

    /// Requests a stop for a command or a fault; the caller has already masked the step interrupt.
    /// The planner task does the rest. For any priority below the interrupt's.
    pub fn request_stop(&self) {
        self.requested.store(1);
        self.stop.store(1);
    }

    /// Requests a stop as [`Self::request_stop`] does, for the sensor of a homing axis.
    pub fn request_sensor_stop(&self) {
        self.stop.store(1);
    }

    /// Returns true from a stop request until the planner task has handled it.
    pub fn is_stopping(&self) -> bool {
        self.stop.load() != 0
    }

    /// Notes that the stop was handled and the motors are at rest. Returns true if anything other
    /// than a sensor asked for it.
    ///
    /// The reason is taken after the flag is cleared: a request that comes in between sets the flag
    /// again and is handled once more, then as if a sensor had asked.
    pub fn stopped(&self) -> bool {
        self.run.store(0);
        self.ran_dry.store(0);
        self.stop.store(0);
        Self::take(&self.requested)
    }

    #[inline(always)]
    fn take(flag: &WordU8) -> bool {
        let is_set = flag.load() != 0;
        if is_set {
            flag.store(0);
        }
        is_set
    }
}
