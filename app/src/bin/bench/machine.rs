//! The least of a machine: it takes moves and is warm; nothing waits, nothing is said.

use core::cell::RefCell;

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{MotionFigures, Reply};
use ferrostep_hal_shim::{Clock, Heater};
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{Limits, Move, Moved, Notice, Planner, StepEntry, StepKind, StepSink};
use ferrostep_printer::{HeaterStatus, Heating, Motion, MotionError, Replies, Seek};

/// Blocks in the look-ahead ring, as in the firmware.
pub const LOOK_AHEAD_BLOCKS: usize = 128;

/// The planner with the firmware's look-ahead ring.
pub type BenchPlanner = Planner<&'static mut [Slot]>;

/// Warm enough to extrude.
const CELSIUS: f32 = 210.0;

/// Takes the printer's moves straight into the planner.
#[derive(Clone, Copy)]
pub struct Machine<'a> {
    /// The planner.
    pub planner: &'a RefCell<BenchPlanner>,
}

impl Motion for Machine<'_> {
    async fn add(&mut self, request: Move) -> Result<Moved, MotionError> {
        self.planner.borrow_mut().add(&request).map_err(MotionError::Move)
    }

    async fn set_fan_power(&mut self, _power: u8) -> Result<(), MotionError> {
        Ok(())
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.planner.borrow_mut().flush();
        Ok(())
    }

    async fn seek(&mut self, _request: Move, _axis: usize) -> Result<Seek, MotionError> {
        Ok(Seek::Triggered)
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.planner.borrow().position_10nm()
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        self.planner.borrow_mut().set_position(position_10nm);
    }

    fn motor_steps(&self) -> [i64; 4] {
        [0; 4]
    }

    fn figures(&self) -> MotionFigures {
        MotionFigures::default()
    }

    fn limits(&self) -> Limits {
        *self.planner.borrow().limits()
    }

    fn set_limits(&mut self, limits: Limits) {
        self.planner.borrow_mut().set_limits(limits);
    }

    fn set_motors_enabled(&mut self, _axes: u8, _enabled: bool) {}

    fn is_end_stop_triggered(&self, _axis: usize) -> bool {
        false
    }

    fn stop(&mut self) -> i64 {
        0
    }
}

impl Heating for Machine<'_> {
    fn set_target(&mut self, _heater: Heater, _celsius: f32) {}

    fn status(&self, _heater: Heater) -> HeaterStatus {
        HeaterStatus { celsius: CELSIUS, target_celsius: CELSIUS, power: 0.0 }
    }

    fn all_off(&mut self) {}
}

/// Time stands still.
#[derive(Clone, Copy)]
pub struct NoTime;

impl Clock for NoTime {
    fn now_ms(&self) -> u64 {
        0
    }
}

impl DelayNs for NoTime {
    async fn delay_ns(&mut self, _ns: u32) {}
}

/// Nobody listens.
pub struct NoReplies;

impl Replies for NoReplies {
    fn send(&self, _reply: Reply<'_>) {}
}

/// Step entries that are kept for the step handler.
pub const KEPT_ENTRIES: usize = 512;

/// Counts what the planner makes, and keeps the last of it.
pub struct Entries {
    /// All entries.
    pub entries: u32,
    /// Step events in them.
    pub events: u32,
    /// The last ones.
    pub kept: heapless::HistoryBuf<StepEntry, KEPT_ENTRIES>,
}

impl Entries {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self { entries: 0, events: 0, kept: heapless::HistoryBuf::new() }
    }
}

impl StepSink for Entries {
    #[inline]
    fn entry(&mut self, entry: StepEntry) {
        self.entries += 1;
        if let StepKind::Stair { count, .. } = entry.kind() {
            self.events += u32::from(count);
        }
        self.kept.write(entry);
    }

    fn notice(&mut self, _notice: Notice) {}
}
