//! The work of the planner task: from look-ahead ring to step queue, while there is room.

use ferrostep_hal_shim::StepOutput;
use ferrostep_planner::interpolator::MAX_ENTRIES;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{MotionMethods, Pace, Progress, TICKS_PER_SECOND};

use super::{Machine, Silence};
use crate::motion::fault::{HomingOutcome, MotionFault};

/// Ticks in a millisecond.
const MS: u64 = TICKS_PER_SECOND as u64 / 1000;

/// The motors start from standstill when this much motion is queued, or [`START_ENTRIES`].
const START_TICKS: u64 = 100 * MS;

/// The motors start from standstill when this many entries are queued, or [`START_TICKS`]. Each
/// block that enters the look-ahead ring lets one leave: without this head start a few short blocks
/// would end before the host has sent the next line.
const START_ENTRIES: usize = 512;

/// Minimum motion in the step queue; below it, blocks leave the look-ahead ring before it is full.
/// Several visits of the planner task, and the time in which it makes a block's steps.
const LOW_TICKS: u64 = 8 * MS;

/// Updates of the step timer that may be missed between two visits of the planner task, 2 ms
/// apart. Nothing in the firmware delays the step interrupt by that much, and each miss only
/// repeats an interval. With more of them the step interrupt is held up or the hardware counts
/// wrong, and motion stops.
pub(super) const MAX_MISSED_UPDATES: u32 = 8;

/// Portions of planning in one call of [`Machine::work`], so that other users of the
/// machine get their turn.
const PORTIONS_AT_ONCE: usize = 256;

impl<R: AsRef<[Slot]> + AsMut<[Slot]>, Q: StepOutput, M: MotionMethods> Machine<R, Q, M> {
    /// Keeps the step queue full; to be called when something was added, and at a steady pace.
    /// Returns true if there is more to do at once.
    pub fn work(&mut self, silence: Silence) -> bool {
        let queue = &mut self.feeder.queue;
        if queue.link().is_stopping() {
            self.follow_stop();
            return false;
        }
        let missed_updates = queue.take_missed_updates();
        self.counts.missed_updates += u64::from(missed_updates);
        if missed_updates > MAX_MISSED_UPDATES {
            self.stop_for(MotionFault::MissedUpdates(missed_updates));
            return true;
        }
        if queue.link().take_ran_dry() && self.in_motion {
            self.counts.underruns += 1;
        }
        let played = queue.played();
        self.feeder.fan.advance(played);
        self.feeder.timeline.pass(played);
        if silence.may_flush {
            self.flush_at_standstill();
        }
        let more = self.plan(silence.may_release);
        if self.is_planned() {
            self.feeder.queue.seal();
            self.planner.set_pace(Pace::FULL);
        }
        self.in_motion = self.planner.is_in_motion() || self.feeder.is_waiting();
        self.start_when_ready();
        more
    }

    /// Starts the motors from standstill when the head start is queued, or no further
    /// motion is to come.
    fn start_when_ready(&mut self) {
        let queue = &self.feeder.queue;
        let waiting = queue.waiting();
        let is_full = queue.room() < MAX_ENTRIES;
        let is_enough = waiting >= START_ENTRIES || self.feeder.remaining_ticks() >= START_TICKS;
        if waiting > 0 && !queue.link().is_running() && (self.flushed || is_full || is_enough) {
            self.feeder.queue.start();
        }
    }

    /// Executes the moves that wait, at standstill, as the host seems to have no further ones.
    fn flush_at_standstill(&mut self) {
        let queue = &self.feeder.queue;
        let something_waits = !self.planner.is_look_ahead_empty() || queue.waiting() > 0;
        if something_waits && !self.flushed && !queue.link().is_running() {
            self.counts.idle_flushes += 1;
            self.flush();
        }
    }

    /// Bounded in time, the ring is seldom full: final blocks leave as soon as enough of them are
    /// there, and always in motion.
    fn release_final(&mut self) -> bool {
        let may_leave = self.is_bounded && (self.feeder.queue.link().is_running() || self.holds_enough());
        may_leave && self.planner.release_final()
    }

    /// Releases a block from a look-ahead ring that is not full, in motion, if steps run out.
    /// Returns true if it did.
    fn release(&mut self) -> bool {
        let runs_out = self.planner.is_in_motion() && self.feeder.remaining_ticks() < LOW_TICKS;
        let releases = runs_out && self.feeder.queue.link().is_running() && !self.planner.is_look_ahead_empty();
        if releases {
            self.planner.release();
        }
        releases
    }

    /// Sets the pace that planning can keep for the blocks to come, after planning that began
    /// at tick `began`.
    fn adjust_pace(&mut self, began: Option<u32>) {
        self.feeder.update_timeline();
        let (Some(began), Some(now)) = (began, self.feeder.queue.now_ticks()) else { return };
        if let Some(pace) = self.workload.add(now.wrapping_sub(began), self.planner.nominal_ticks()) {
            self.counts.planning_slowdowns += u64::from(pace < self.planner.pace());
            self.planner.set_pace(pace);
        }
    }

    /// Plans while there is room. Returns true if there is more to do at once.
    fn plan(&mut self, may_release: bool) -> bool {
        for _ in 0..PORTIONS_AT_ONCE {
            if self.feeder.queue.room() < MAX_ENTRIES || self.feeder.fan.is_full() {
                return false;
            }
            self.feeder.queue.planning_begins();
            let began = self.feeder.queue.now_ticks();
            let seeking = self.feeder.seeking;
            let progress =
                if self.feeder.correct() { Progress::Worked } else { self.planner.advance(&mut self.feeder) };
            if self.feeder.seeking != seeking {
                self.end_seek(HomingOutcome::Triggered);
            }
            if let Some(fault) = self.feeder.take_fault() {
                self.count(fault);
                self.stop_for(fault);
                return true;
            }
            if progress == Progress::Waiting {
                if self.release_final() {
                    continue;
                }
                if may_release && self.release() {
                    continue;
                }
                return false;
            }
            self.feeder.queue.planning_ends();
            self.adjust_pace(began);
        }
        true
    }

    /// Counts a fault of the planned steps.
    fn count(&mut self, fault: MotionFault) {
        match fault {
            MotionFault::Miscount(_) => self.counts.miscounts += 1,
            MotionFault::StepsTooNear => self.counts.refused_entries += 1,
            MotionFault::MissedUpdates(_) => {}
        }
    }
}
