//! The step queue's near end; each call takes time.

use ferrostep_hal_shim::{MotionWatch, MotorEnable, PlanningClock, StepQueue};
use ferrostep_planner::{StepDigests, StepEntry, StepObserver};
use ferrostep_step_player::{DroppedSteps, FeedError, StepFeeder, StepLink, Stepping};
use ferrostep_virtual_board::CYCLES_A_TICK;

use super::STEP_QUEUE_SLOTS;
use super::interrupts::Interrupts;
use super::time::Costs;

/// Cycles before and after a call, in which an interrupt may come.
const CALL: u64 = 20;

/// Queue of a board; the interrupts continue while it is filled.
pub struct Queue<'a, M> {
    feeder: StepFeeder<'a, M, 1, STEP_QUEUE_SLOTS>,
    interrupts: &'a Interrupts<'a, M>,
    costs: Costs,
    digests: StepDigests,
}

impl<'a, M: Stepping> Queue<'a, M> {
    pub(super) fn new(
        feeder: StepFeeder<'a, M, 1, STEP_QUEUE_SLOTS>,
        interrupts: &'a Interrupts<'a, M>,
        costs: Costs,
    ) -> Self {
        Self { feeder, interrupts, costs, digests: StepDigests::default() }
    }

    /// Runs the planner task for this number of cycles, multiplied by its present slowness.
    fn plan_for(&self, cycles: u64) {
        self.interrupts.pass(cycles * self.costs.slowness_at(self.interrupts.now()));
    }
}

impl<M: Stepping> StepQueue for Queue<'_, M> {
    fn queued(&self) -> u32 {
        self.feeder.queued()
    }

    fn played(&self) -> u32 {
        self.feeder.played()
    }

    fn waiting(&self) -> usize {
        self.feeder.waiting()
    }

    fn room(&self) -> usize {
        self.feeder.room()
    }

    fn push(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        self.plan_for(self.costs.entry);
        self.feeder.push(entry)
    }

    fn seal(&mut self) {
        self.interrupts.pass(CALL);
        self.feeder.seal();
    }

    fn start(&mut self) {
        self.interrupts.pass(CALL);
        if self.feeder.start() {
            self.interrupts.start_or_end();
        }
    }

    fn link(&self) -> &StepLink {
        self.feeder.link()
    }

    fn unplayed_steps(&self) -> [i32; 4] {
        self.feeder.unplayed_steps()
    }

    fn request_stop(&mut self) {
        self.interrupts.stop();
    }

    fn drop_all(&mut self) -> DroppedSteps {
        self.interrupts.pass(CALL);
        let dropped = self.feeder.drop_all();
        for word in self.feeder.rest_words() {
            self.interrupts.write(word);
        }
        dropped
    }

    /// The model's interrupt is never late.
    fn take_missed_updates(&mut self) -> u32 {
        self.interrupts.pass(CALL);
        0
    }
}

impl<M> StepObserver for Queue<'_, M> {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.digests.stepped(tick, axes, directions);
    }
}

impl<M: Stepping> MotionWatch for Queue<'_, M> {
    fn digests(&self) -> StepDigests {
        self.digests
    }

    fn move_ended(&mut self, _tick: u64, _line: u32) {
        self.plan_for(self.costs.planned_move);
    }
}

impl<M: Stepping> PlanningClock for Queue<'_, M> {
    fn now_ticks(&self) -> Option<u32> {
        Some((self.interrupts.now() / CYCLES_A_TICK) as u32)
    }
}

impl<M> MotorEnable for Queue<'_, M> {
    /// The motors of the model hold without current.
    fn set_motors_enabled(&mut self, _axes: u8, _enabled: bool) {}
}
