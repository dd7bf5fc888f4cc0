//! Moves whose entry speeds were planned elsewhere, and what somebody needs who plans for others.
//!
//! A prepared move is planned like any other but for two things: nobody asks whether it continues the one before (it says
//! so), and there is no reverse pass (it brings its speed). Limits, corners and the processor's budget are worked out anew
//! from where it goes, so a plan can only ask for less than they allow, and one that asks for more is found out.

use super::{Move, MoveError, Moved, Planner};
use crate::block::{Block, PlannedBlock, Speed, SquaredSpeed};
use crate::inner_ends::Stretches;
use crate::junction::Pull;
use crate::kinematics::{Coordinate, narrow};
use crate::look_ahead::{Entry, Left, Marker, Slot, Violation};
use crate::motion_choice::AccelerationProfile;
use crate::time_law::TimeLaw;

/// A move of a prepared job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreparedMove {
    /// Where X, Y and Z end, machine coordinates.
    pub target: [Coordinate; 3],
    /// Filament to push (or draw back), units of 0.1 nm.
    pub filament_100pm: i64,
    /// Speed along the path, of the filament where nothing else moves, mm/s; above zero.
    pub feed_mm_per_s: f32,
    /// Number of the source line.
    pub line: u32,
    /// Whether the line's move ends here (an arc has many).
    pub ends_move: bool,
    /// Whether the filament counts in the G-code's E coordinate; that of a firmware retraction does not. Planning does not
    /// ask.
    pub counts: bool,
    /// Planned speed at its start.
    pub entry: Entry,
}

impl PreparedMove {
    /// Where X, Y and Z end, units of 10 nm.
    #[inline(always)]
    pub fn target_10nm(&self) -> [i32; 3] {
        self.target.map(Coordinate::units)
    }

    /// The move with this filament, units of 0.1 nm, at this feed, mm/s.
    fn with(&self, filament_100pm: i64, feed_mm_per_s: f32) -> Move {
        let Self { line, ends_move, .. } = *self;
        Move { target_10nm: self.target_10nm().map(i64::from), filament_100pm, feed_mm_per_s, line, ends_move }
    }
}

/// What of a prepared move is another now than when it was planned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Retuned {
    /// Filament at the flow of now (M221), units of 0.1 nm.
    pub filament_100pm: i64,
    /// Speed at the feed of now (M220), mm/s; `None` if that has not been changed.
    pub feed_mm_per_s: Option<f32>,
}

/// A block of a prepared job, for formats that have blocks and no moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreparedBlock {
    /// The block.
    pub block: Block,
    /// Planned speed at its start.
    pub entry: Speed,
    /// The most that the corner before it allows.
    pub max_entry: Speed,
}

/// What leaves the look-ahead ring for somebody who writes it down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Recorded {
    /// A block.
    Block {
        /// The block and its speeds.
        planned: PlannedBlock,
        /// Squared entry speed as the reverse pass has it.
        entry: SquaredSpeed,
        /// What the corner and both nominal speeds allow.
        bound: SquaredSpeed,
    },
    /// The fan changes.
    FanPower {
        /// Power, 0 to 255.
        power: u8,
    },
}

/// What the open block brings, where it was prepared.
#[derive(Clone, Copy, Debug)]
pub(super) struct OpenPrepared {
    pub entry: Entry,
    /// Nominal speed at the feed of now.
    pub nominal: Speed,
}

/// What steps tell of the corners before a block and inside it.
struct CornersOfSteps {
    /// The stretch before.
    before: Option<Block>,
    first: Speed,
    /// The slowest of those inside.
    inner: Speed,
}

/// Filament of a prepared move at the flow of now, units of 0.1 nm.
fn filament_now(prepared: &PreparedMove, now: Option<&Retuned>) -> i64 {
    now.map_or(prepared.filament_100pm, |now| now.filament_100pm)
}

impl<S: AsRef<[Slot]> + AsMut<[Slot]>> Planner<S> {
    /// Takes a move of a prepared job. Feed and flow may have been changed since it was planned: `now` is what they are then.
    /// Its corners remain those of the plan, whose speeds follow from them.
    ///
    /// # Errors
    /// As [`Self::add`], and [`MoveError::Violation`] where the plan cannot be followed: the moves taken before are
    /// executed as far as they can be trusted, to a standstill on the path, and no other is taken until
    /// [`Self::stand_at`] says where the motors are.
    #[inline(never)]
    pub fn add_prepared(&mut self, prepared: &PreparedMove, now: Option<&Retuned>) -> Result<Moved, MoveError> {
        self.expect_prepared()?;
        if prepared.entry == Entry::Continues && self.open.is_some() && !self.flushing {
            return self.join_prepared(prepared, now);
        }
        let request = &prepared.with(filament_now(prepared, now), prepared.feed_mm_per_s);
        let Some(next) = self.next(request)? else { return Ok(Moved::Nothing) };
        if !self.close() {
            return Err(MoveError::NoRoom);
        }
        if let Some(violation) = self.take_violation().or(self.violation) {
            return Err(MoveError::Violation(violation));
        }
        let planned = self.plan_apart(request, &next, prepared.filament_100pm);
        let nominal = self.nominal_now(prepared, now, planned.block.nominal);
        self.open.begin(&planned);
        self.open_prepared = Some(OpenPrepared { entry: prepared.entry, nominal });
        self.follow(&next, &planned);
        Ok(Moved::Queued)
    }

    /// Takes a move that continues the block before.
    #[inline(never)]
    fn join_prepared(&mut self, prepared: &PreparedMove, now: Option<&Retuned>) -> Result<Moved, MoveError> {
        let request = &prepared.with(filament_now(prepared, now), prepared.feed_mm_per_s);
        let Some(next) = self.next(request)? else { return Ok(Moved::Nothing) };
        let planned = self.plan_apart(request, &next, prepared.filament_100pm);
        let nominal = self.nominal_now(prepared, now, planned.block.nominal);
        if !self.open.absorb_prepared(&planned) {
            return Err(self.violated(Violation::NotContinued));
        }
        self.merged_moves += 1;
        if let Some(open) = &mut self.open_prepared {
            open.nominal = open.nominal.min(nominal);
        }
        self.follow(&next, &planned);
        Ok(Moved::Queued)
    }

    /// The nominal speed of a move at its feed of now; the planned one where that cannot be.
    fn nominal_now(&self, prepared: &PreparedMove, now: Option<&Retuned>, planned: Speed) -> Speed {
        let Some(&Retuned { filament_100pm, feed_mm_per_s: Some(feed_mm_per_s) }) = now else { return planned };
        let request = &prepared.with(filament_100pm, feed_mm_per_s);
        let Ok(Some(next)) = self.next(request) else { return planned };
        self.plan_apart(request, &next, prepared.filament_100pm).block.nominal
    }

    /// Takes a block of a prepared job.
    ///
    /// A block comes without the positions it was made from: its limits and its corner are checked as far as its steps can
    /// tell.
    ///
    /// # Errors
    /// As [`Self::add_prepared`].
    pub fn add_prepared_block(&mut self, prepared: &PreparedBlock) -> Result<(), MoveError> {
        self.expect_prepared()?;
        if !self.close() || !self.look_ahead.has_room() {
            return Err(MoveError::NoRoom);
        }
        let mut motor_steps = self.motor_steps;
        for (position, steps) in motor_steps.iter_mut().zip(prepared.block.steps) {
            *position = position.checked_add(steps).ok_or(MoveError::TooFar)?;
        }
        let target_10nm = self.geometry.position_10nm(motor_steps.map(i64::from));
        let Some(target_10nm) = narrow(target_10nm) else { return Err(MoveError::TooFar) };
        let mut corners =
            CornersOfSteps { before: self.previous_steps, first: Speed(u32::MAX), inner: Speed(u32::MAX) };
        for stretch in Stretches::of(&prepared.block) {
            let part = prepared.block.part(&stretch);
            if !self.keeps_limits(&part) {
                return Err(self.violated(Violation::BeyondLimits));
            }
            let corner = self.corner_of_steps(corners.before.as_ref(), &part);
            if stretch.before_10nm == 0 {
                corners.first = corner
            } else {
                corners.inner = corners.inner.min(corner)
            }
            corners.before = Some(part);
        }
        if corners.inner < prepared.block.nominal {
            return Err(self.violated(Violation::TooFast));
        }
        let junction = corners.first.min(prepared.max_entry);
        let entry = Entry::Given(prepared.entry.into());
        let nominal = prepared.block.nominal;
        match self.look_ahead.push_prepared(&prepared.block, nominal, junction, entry) {
            Ok(()) => {}
            Err(violation) => return Err(self.violated(violation)),
        }
        self.previous.pull = Pull::ZERO;
        self.previous_steps = corners.before;
        self.extruder.advance_256ths(prepared.block.extruder_256ths);
        self.extruder_256ths = self.extruder.position_256ths();
        self.position_10nm = target_10nm;
        self.motor_steps = motor_steps;
        Ok(())
    }

    /// Whether a position is where the motors stand; then it is the position from now on.
    pub fn refine_position(&mut self, position_10nm: [i64; 3]) -> bool {
        let Some(near) = narrow(position_10nm) else { return false };
        let stands = self.geometry.motor_steps(position_10nm) == self.motor_steps;
        if stands {
            self.position_10nm = near;
        }
        stands
    }

    /// Why the plan of a job's last block cannot be followed, if no error has told yet. Motion has ended before it, and
    /// [`Self::stand_at`] is to say where.
    pub fn take_violation(&mut self) -> Option<Violation> {
        self.violation.filter(|_| core::mem::take(&mut self.is_violation_untold))
    }

    /// Motion ends with what was taken so far, and nothing else is until the motors' place is known.
    fn violated(&mut self, violation: Violation) -> MoveError {
        self.violation = Some(violation);
        self.flush();
        MoveError::Violation(violation)
    }

    /// The open block, if it is a prepared one, enters the ring; `false` without room.
    #[inline(never)]
    pub(super) fn close_prepared(&mut self) -> bool {
        let Some(prepared) = self.open_prepared else { return true };
        if !self.look_ahead.has_room() {
            return false;
        }
        self.push_open(prepared);
        self.open.clear();
        self.open_prepared = None;
        true
    }

    /// The open block enters the ring, which has room. One that breaks the plan's rules is dropped, and those before it end
    /// in standstill.
    #[inline(always)]
    fn push_open(&mut self, prepared: OpenPrepared) {
        let OpenPrepared { entry, nominal } = prepared;
        let nominal = self.hold_budget(nominal);
        if let Err(violation) = self.look_ahead.push_prepared(&self.open.block, nominal, self.open.junction, entry) {
            self.violation = Some(violation);
            self.is_violation_untold = true;
            self.flushing = true;
        }
    }

    /// Gives the open block the nominal speed of its feed of now, within the budget; returns the planned one, also within it.
    #[inline(never)]
    fn hold_budget(&mut self, now: Speed) -> Speed {
        let open = &mut self.open;
        let cost = self.budget.cost(&open.block, open.events, open.moves);
        let mut planned = open.block.nominal;
        let is_as_planned = now == planned;
        if let Some(slower) = cost.slower_nominal(planned) {
            planned = slower;
            self.slowed_moves += u64::from(open.moves);
        }
        open.block.nominal = if is_as_planned { planned } else { cost.slower_nominal(now).unwrap_or(now) };
        planned
    }

    /// The next move or block is a prepared one: an error where it cannot be, or not yet.
    #[inline(never)]
    fn expect_prepared(&mut self) -> Result<(), MoveError> {
        if let Some(violation) = self.take_violation().or(self.violation) {
            // Motion ends before it.
            self.close();
            return Err(MoveError::Violation(violation));
        }
        if self.choice.acceleration != AccelerationProfile::Trapezoid {
            return Err(MoveError::OtherLaw);
        }
        if !self.look_ahead.is_prepared() && !self.begin_prepared() {
            return Err(MoveError::NoRoom);
        }
        Ok(())
    }

    /// The ring takes prepared blocks from now on; `false` as long as others are in it, and these leave.
    fn begin_prepared(&mut self) -> bool {
        self.drain() && {
            self.look_ahead.begin_prepared();
            true
        }
    }

    /// The ring takes blocks without speeds again; `false` as long as others are in it, and these leave.
    #[inline(never)]
    pub(super) fn end_prepared(&mut self) -> bool {
        self.drain() && {
            if let Some(law) = super::speed_law(&self.choice) {
                self.look_ahead.set_law(&law);
            }
            true
        }
    }

    /// Whether the ring is empty; otherwise all in it shall leave.
    fn drain(&mut self) -> bool {
        let empty = self.is_look_ahead_empty();
        if !empty && !self.draining {
            self.flush();
        }
        self.draining = !empty;
        empty
    }

    /// For those who count what planning costs: takes the next block that may leave, shows it with its speeds, and does
    /// nothing more. Whether there was one.
    pub fn take_planned(&mut self, see: impl FnOnce(&PlannedBlock)) -> bool {
        loop {
            match &self.pop() {
                Some(Left::Block(planned)) => see(planned),
                Some(Left::Part(part)) => see(&self.along(part).0),
                Some(Left::Marker(_)) => continue,
                None => return false,
            }
            return true;
        }
    }

    /// For those who prepare a job: takes what may leave look-ahead next without executing it.
    pub fn next_recorded(&mut self) -> Option<Recorded> {
        Some(match self.pop()? {
            Left::Block(planned) => {
                self.motion_ticks += TimeLaw::trapezoid(&planned).duration_ticks();
                let (entry, bound) = self.look_ahead.left_entry();
                Recorded::Block { planned, entry, bound }
            }
            Left::Part(part) => {
                let (planned, law) = self.along(&part);
                self.motion_ticks += law.duration_ticks();
                let (entry, bound) = (planned.entry.into(), planned.entry.into());
                Recorded::Block { planned, entry, bound }
            }
            Left::Marker(Marker::FanPower { power }) => Recorded::FanPower { power },
        })
    }
}
