//! Time that motion spends on homing, which a print's motion time leaves out.

/// Ticks of homing.
#[derive(Clone, Copy, Debug, Default)]
pub struct HomingTime {
    /// The motion's ticks when the present homing began.
    since: Option<u64>,
    ticks: u64,
}

impl HomingTime {
    /// Homing begins after this many ticks of motion, unless it has begun before.
    pub fn begin(&mut self, motion_ticks: u64) {
        self.since.get_or_insert(motion_ticks);
    }

    /// Homing has set the position of an axis, after this many ticks of motion.
    pub fn end(&mut self, motion_ticks: u64) {
        if let Some(since) = self.since.take() {
            self.ticks += motion_ticks.saturating_sub(since);
        }
    }

    /// Ticks of all homing that has ended.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }
}
