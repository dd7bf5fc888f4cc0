//! Execution: turns the blocks that leave look-ahead into step entries.

use super::Planner;
use crate::block::{PlannedBlock, Speed};
use crate::methods::{MotionMethods, SpeedRule};
use crate::pressure_advance::AdvanceLaw;
use crate::ring::{Marker, RingMemory};
use crate::s_curve::law::Curve;
use crate::speed_plan::{Part, Released};
use crate::step_queue::{Notice, StepSink};
use crate::time_law::TimeLaw;

/// Result of [`Planner::advance`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Some work; call again.
    Worked,
    /// No work: no block may leave the look-ahead ring now.
    Waiting,
}

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// Does a little work; hands at most [`crate::interpolator::MAX_ENTRIES`] entries and two
    /// notices to `sink`.
    #[inline]
    pub fn advance(&mut self, sink: &mut impl StepSink) -> Progress {
        if self.interpolator.is_busy() {
            self.interpolator.advance(sink);
            if !self.interpolator.is_busy() {
                let motor_steps = self.released.motor_steps();
                sink.notice(Notice::BlockEnded { tick: self.interpolator.notice_tick(), motor_steps });
            }
            return Progress::Worked;
        }
        if self.shaped.is_busy() {
            self.advance_shaped(sink);
            return Progress::Worked;
        }
        match self.release_next() {
            Some(Released::Block(planned)) => {
                let law = self.law(&planned);
                self.begin(&planned, &law, sink);
            }
            Some(Released::Part(part)) => {
                let (planned, law) = self.along(&part);
                self.begin(&planned, &law, sink);
            }
            Some(Released::Marker(marker)) => {
                self.pass_marker(&marker, sink);
            }
            None if self.must_rest() => self.tallies.motion_ticks += self.shaped.begin_rest(),
            None => return Progress::Waiting,
        }
        Progress::Worked
    }

    /// Executes a marker between blocks.
    #[cold]
    fn pass_marker(&mut self, marker: &Marker, sink: &mut impl StepSink) {
        match *marker {
            Marker::FanPower { fan, power } => {
                let is_shaped = !self.shaped.is_at_rest();
                let tick = if is_shaped { self.shaped.notice_tick() } else { self.interpolator.notice_tick() };
                sink.notice(Notice::FanPower { tick, fan, power });
            }
            Marker::PressureAdvance(advance) => {
                let [.., steps_per_mm] = self.rules.geometry.steps_per_mm;
                self.shaped.set_advance(AdvanceLaw::new(&advance, steps_per_mm.to_f64()));
            }
        }
    }

    /// True if the plan is at standstill and the motors are not: the content of the filters
    /// must still be executed.
    fn must_rest(&self) -> bool {
        self.shaped.is_in_motion() && self.exit == Speed::ZERO && self.is_look_ahead_empty()
    }

    /// Events of shaped motion.
    #[inline(never)]
    fn advance_shaped(&mut self, sink: &mut impl StepSink) {
        self.shaped.advance(sink);
        if self.shaped.is_at_rest() {
            self.interpolator.resume(&self.shaped.standing());
            let motor_steps = self.released.motor_steps();
            sink.notice(Notice::BlockEnded { tick: self.interpolator.notice_tick(), motor_steps });
        }
    }

    /// True if the blocks to come are shaped.
    pub(super) fn is_shaping(&self) -> bool {
        self.shaping.is_active() && !self.is_unshaped
    }

    /// Begins a block whose motors follow it through their filters.
    #[inline(never)]
    fn begin_shaped(&mut self, planned: &PlannedBlock, law: &TimeLaw<M::Pieces>) -> u64 {
        if !self.shaped.is_in_motion() {
            let ([x, y, z], [dx, dy, dz]) = (self.released.steps, planned.block.steps);
            let steps = [x.wrapping_sub(dx), y.wrapping_sub(dy), z.wrapping_sub(dz)];
            self.shaped.start(&self.interpolator.standing(steps));
        }
        self.shaped.begin(planned, law)
    }

    /// The law of a block that has one by itself.
    #[inline]
    pub(super) fn law(&self, planned: &PlannedBlock) -> TimeLaw<M::Pieces> {
        match &self.rule {
            None => TimeLaw::trapezoid(planned),
            Some(rule) => TimeLaw::Other(rule.law(planned)),
        }
    }

    #[inline]
    fn begin(&mut self, planned: &PlannedBlock, law: &TimeLaw<M::Pieces>, sink: &mut impl StepSink) {
        self.exit = planned.exit;
        let nominal_ticks = self.queue.last_nominal().ticks_for(planned.block.length_10nm);
        self.tallies.nominal_ticks = self.tallies.nominal_ticks.saturating_add(nominal_ticks);
        let is_shaped = self.shaped.is_in_motion() || self.is_shaping();
        self.tallies.motion_ticks +=
            if is_shaped { self.begin_shaped(planned, law) } else { self.interpolator.begin(planned, law, sink) };
    }

    /// The speeds and the law of a block of a run.
    #[inline(never)]
    pub(super) fn along(&mut self, part: &Part) -> (PlannedBlock, TimeLaw<M::Pieces>) {
        let entry = if part.offset_10nm == 0 {
            self.curve = Curve::new(&part.run);
            part.run.entry
        } else {
            self.exit
        };
        let (law, exit) = TimeLaw::along(&self.curve, part.offset_10nm, part.block.length_10nm);
        let ends_run = part.offset_10nm.saturating_add(part.block.length_10nm) >= part.run.length_10nm;
        let exit = if ends_run { part.run.exit } else { exit };
        self.exit = exit;
        (PlannedBlock { block: part.block, entry, exit }, law)
    }

    /// Takes the next block or marker that may leave look-ahead now.
    #[inline]
    pub(super) fn release_next(&mut self) -> Option<Released> {
        if self.flushing {
            self.close_open_block();
        }
        let released = self.queue.pop(self.pace);
        if let Some(Released::Block(PlannedBlock { block, .. }) | Released::Part(Part { block, .. })) = &released {
            self.released.advance(block);
        }
        released
    }
}
