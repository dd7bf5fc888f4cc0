//! Requests for motion.

use super::Planner;
use super::block_rules::Travel;
use super::move_error::{MoveError, Moved};
use crate::kinematics::narrow;
use crate::methods::MotionMethods;
use crate::ring::RingMemory;
use crate::speed_plan::EntrySpeed;

/// Motion that a [`Planner`] can be asked for: a [`Move`], a [`crate::Prepared`] move, or what
/// another crate makes of [`Planner::add_given_block`].
pub trait Request {
    /// Adds it to the motion that a planner has taken. Where it needs room, `make_room` is asked
    /// for it, and says whether it made any.
    ///
    /// # Errors
    /// See [`MoveError`]; nothing has changed then, but for a plan's fault, see
    /// [`MoveError::Plan`].
    fn add_to<S: RingMemory, M: MotionMethods>(
        &self,
        planner: &mut Planner<S, M>,
        make_room: impl FnMut(&mut Planner<S, M>) -> bool,
    ) -> Result<Moved, MoveError>;

    /// Returns the move, for a recorder to write down; `None` if it has no path.
    fn as_move(&self) -> Option<Move> {
        None
    }
}

/// A straight move to a machine position, whose speeds the planner plans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Target of X, Y and Z, machine coordinates in units of 10 nm, at most 5 m either way.
    pub target_10nm: [i64; 3],
    /// Filament to push (or draw back), units of 0.1 nm.
    pub filament_100pm: i64,
    /// Speed along the path, mm/s; that of the filament if it moves alone.
    pub feed_mm_per_s: f32,
    /// Number of the source line.
    pub line: u32,
    /// True if the line's move ends here.
    pub ends_move: bool,
}

impl Request for Move {
    fn add_to<S: RingMemory, M: MotionMethods>(
        &self,
        planner: &mut Planner<S, M>,
        mut make_room: impl FnMut(&mut Planner<S, M>) -> bool,
    ) -> Result<Moved, MoveError> {
        if !planner.use_look_ahead() {
            return Err(MoveError::NoRoom);
        }
        let Self { filament_100pm, feed_mm_per_s, line, ends_move, .. } = *self;
        let target_10nm = narrow(self.target_10nm).ok_or(MoveError::TooFar)?;
        let corner_filament_100pm = filament_100pm;
        let travel =
            Travel { target_10nm, filament_100pm, corner_filament_100pm, feed_mm_per_s, line, ends_move, part: None };
        let Some(target) = planner.rules.target(&travel, &planner.position)? else { return Ok(Moved::Nothing) };
        if planner.choice.filament_on_the_way && planner.holds_back(&travel, &target, &mut make_room)? {
            return Ok(Moved::Queued);
        }
        let mut planned = planner.rules.plan(&travel, &target, &planner.previous);
        planner.keep_tolerance(&mut planned);
        if !planner.flushing && planner.shares_blocks() && planner.open.absorb(&planned) {
            planner.tallies.merged_moves += 1;
        } else {
            planner.close_making_room(make_room)?;
            planner.open.begin(&planned, EntrySpeed::Bound, planned.nominal);
        }
        if planner.open.is_full() && planner.rules.tolerance.is_none() {
            // Now, not with the next move: a host may wait until the speeds before this block are
            // known to be final.
            planner.close_open_block();
        }
        planner.advance_position(&target, &planned, 0.0);
        Ok(Moved::Queued)
    }

    fn as_move(&self) -> Option<Move> {
        Some(*self)
    }
}

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// Takes motion.
    ///
    /// # Errors
    /// See [`MoveError`].
    pub fn add(&mut self, request: &impl Request) -> Result<Moved, MoveError> {
        request.add_to(self, |_| false)
    }

    /// Version of [`Self::add`] that makes room while the motion needs it: `make_room` takes a
    /// block with [`Self::next_planned`] or a [`crate::Recorder`], and returns false if there was
    /// none. A move is then planned once, not again after it was refused.
    ///
    /// # Errors
    /// See [`MoveError`].
    pub fn add_making_room(
        &mut self,
        request: &impl Request,
        make_room: impl FnMut(&mut Self) -> bool,
    ) -> Result<Moved, MoveError> {
        request.add_to(self, make_room)
    }
}
