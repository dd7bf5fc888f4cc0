//! Moves whose entry speeds were planned elsewhere.
//!
//! A prepared move is planned like any other but for two things: it says itself whether it
//! continues the one before, and it brings its entry speed, so there is no reverse pass. Limits,
//! corners and the processor's budget are worked out anew from where it goes: a plan can only ask
//! for less than they allow, and one that asks for more is refused.

use super::Planner;
use super::block_rules::Travel;
use super::move_error::{MoveError, Moved};
use super::request::{Move, Request};
use crate::block::Speed;
use crate::kinematics::Coordinate;
use crate::methods::MotionMethods;
use crate::motion_choice::AccelerationProfile;
use crate::ring::RingMemory;
use crate::speed_plan::{EntrySpeed, PlanFault};

/// A move of a prepared job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreparedMove {
    /// Target of X, Y and Z, machine coordinates.
    pub target: [Coordinate; 3],
    /// Filament to push (or draw back), units of 0.1 nm.
    pub filament_100pm: i64,
    /// Speed along the path, mm/s; that of the filament if it moves alone; above zero.
    pub feed_mm_per_s: f32,
    /// Number of the source line.
    pub line: u32,
    /// True if the line's move ends here (an arc has many).
    pub ends_move: bool,
    /// True if the filament counts in the G-code's E coordinate; that of a firmware retraction does
    /// not. Planning does not use this.
    pub counts: bool,
    /// Planned speed at its start.
    pub entry: EntrySpeed,
}

impl PreparedMove {
    /// Target of X, Y and Z, units of 10 nm.
    #[inline(always)]
    pub fn target_10nm(&self) -> [i32; 3] {
        self.target.map(Coordinate::units)
    }

    /// The move with this filament, units of 0.1 nm, at this feed, mm/s.
    #[inline(always)]
    fn with(&self, filament_100pm: i64, feed_mm_per_s: f32) -> Travel {
        let Self { filament_100pm: corner_filament_100pm, line, ends_move, .. } = *self;
        let target_10nm = self.target_10nm();
        Travel { target_10nm, filament_100pm, corner_filament_100pm, feed_mm_per_s, line, ends_move, part: None }
    }
}

/// Differences between a prepared move's plan and its execution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Retuned {
    /// Filament at the present flow (M221), units of 0.1 nm.
    pub filament_100pm: i64,
    /// Speed at the present feed (M220), mm/s; `None` if that has not been changed.
    pub feed_mm_per_s: Option<f32>,
}

/// Asks for a prepared move. Its corners remain those of the plan, whose speeds follow from them,
/// even where feed and flow have been changed since.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prepared<'a> {
    /// The move as it was planned.
    pub planned: &'a PreparedMove,
    /// Feed and flow, if they have been changed.
    pub now: Option<&'a Retuned>,
}

impl Request for Prepared<'_> {
    fn as_move(&self) -> Option<Move> {
        let PreparedMove { filament_100pm, feed_mm_per_s, line, ends_move, .. } = *self.planned;
        let target_10nm = self.planned.target_10nm().map(i64::from);
        let filament_100pm = self.now.map_or(filament_100pm, |now| now.filament_100pm);
        Some(Move { target_10nm, filament_100pm, feed_mm_per_s, line, ends_move })
    }

    #[inline(never)]
    fn add_to<S: RingMemory, M: MotionMethods>(
        &self,
        planner: &mut Planner<S, M>,
        make_room: impl FnMut(&mut Planner<S, M>) -> bool,
    ) -> Result<Moved, MoveError> {
        planner.use_given_speeds()?;
        let prepared = self.planned;
        let continues = prepared.entry == EntrySpeed::Continues && planner.open.is_some() && !planner.flushing;
        let filament_100pm = self.now.map_or(prepared.filament_100pm, |now| now.filament_100pm);
        let travel = prepared.with(filament_100pm, prepared.feed_mm_per_s);
        let Some(target) = planner.rules.target(&travel, &planner.position)? else { return Ok(Moved::Nothing) };
        let mut planned = planner.rules.plan(&travel, &target, &planner.previous);
        planner.keep_tolerance(&mut planned);
        if !continues {
            planner.close_making_room(make_room)?;
            planner.check_plan()?;
        }
        let nominal = self.now.map_or(planned.nominal, |now| self.nominal_at(now, planner, planned.nominal));
        if !continues {
            planner.open.begin(&planned, prepared.entry, nominal);
        } else if planner.open.absorb_prepared(&planned, nominal) {
            planner.tallies.merged_moves += 1;
        } else {
            return Err(planner.fail(PlanFault::NotContinued));
        }
        planner.advance_position(&target, &planned, 0.0);
        Ok(Moved::Queued)
    }
}

impl Prepared<'_> {
    /// Nominal speed at another feed; an invalid feed keeps the planned speed.
    #[cold]
    #[inline(never)]
    fn nominal_at<S: RingMemory, M: MotionMethods>(
        &self,
        now: &Retuned,
        planner: &Planner<S, M>,
        planned: Speed,
    ) -> Speed {
        let Retuned { filament_100pm, feed_mm_per_s: Some(feed_mm_per_s) } = *now else { return planned };
        let travel = self.planned.with(filament_100pm, feed_mm_per_s);
        let Ok(Some(target)) = planner.rules.target(&travel, &planner.position) else { return planned };
        planner.rules.plan(&travel, &target, &planner.previous).nominal
    }
}

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// The next motion brings its speeds.
    ///
    /// # Errors
    /// It cannot, or not until the motion in the ring has left.
    #[inline(never)]
    pub(super) fn use_given_speeds(&mut self) -> Result<(), MoveError> {
        if let Err(fault) = self.check_plan() {
            // Motion ends before it.
            self.close_open_block();
            return Err(fault);
        }
        if self.choice.acceleration != AccelerationProfile::Trapezoid {
            return Err(MoveError::Plan(PlanFault::NotTrapezoid(self.choice.acceleration)));
        }
        if !self.queue.has_given_speeds() {
            if !self.drain() {
                return Err(MoveError::NoRoom);
            }
            self.queue.take_given_speeds();
        }
        Ok(())
    }

    /// The next motion's speeds are planned here; `false` until prepared motion in
    /// the ring has left.
    pub(super) fn use_look_ahead(&mut self) -> bool {
        if self.queue.has_given_speeds() {
            if !self.drain() {
                return false;
            }
            if let Ok(law) = super::choice::speed_law::<M>(&self.choice) {
                self.queue.look_ahead(&law);
            }
        }
        true
    }

    /// Releases everything in the ring; returns true if it is empty.
    fn drain(&mut self) -> bool {
        let empty = self.is_look_ahead_empty();
        if !empty && !self.queue.is_switching {
            self.flush();
        }
        self.queue.is_switching = !empty;
        empty
    }

    /// An error if the plan of the present job has a fault.
    #[inline(always)]
    pub(super) fn check_plan(&mut self) -> Result<(), MoveError> {
        self.queue.report_fault().map_or(Ok(()), |fault| Err(MoveError::Plan(fault)))
    }

    /// Motion ends with the moves taken so far, and no more of the job is taken.
    #[cold]
    pub(super) fn fail(&mut self, fault: PlanFault) -> MoveError {
        self.queue.note_reported_fault(fault);
        self.flush();
        MoveError::Plan(fault)
    }

    /// The fault in the plan of a job's last block, if no error has reported it. Motion has ended
    /// before that block, and [`Self::reset_to`] is to say where.
    pub fn take_plan_fault(&mut self) -> Option<PlanFault> {
        self.queue.take_unreported_fault()
    }
}
