//! What the planner can be asked for.

use super::Planner;
use super::block_rules::Travel;
use crate::given_speeds::{EntrySpeed, PlanFault};
use crate::kinematics::narrow;
use crate::methods::MotionMethods;
use crate::ring::RingMemory;

/// Motion that a [`Planner`] can be asked for: a [`Move`], a [`super::Prepared`] move or a [`super::PreparedBlock`].
pub trait Request {
    /// Adds it to the motion that a planner has taken. Where it needs room, `make_room` is asked for it, and says whether it
    /// made any.
    ///
    /// # Errors
    /// See [`MoveError`]; nothing has changed then, but for a plan's fault, see [`MoveError::Plan`].
    fn add_to<S: RingMemory, M: MotionMethods>(
        &self,
        planner: &mut Planner<S, M>,
        make_room: impl FnMut(&mut Planner<S, M>) -> bool,
    ) -> Result<Moved, MoveError>;

    /// The move, if its speeds are planned here: what a recorder writes down.
    fn as_move(&self) -> Option<&Move> {
        None
    }
}

/// A straight move to a machine position, whose speeds the planner plans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Where X, Y and Z end, machine coordinates in units of 10 nm, at most 5 m either way.
    pub target_10nm: [i64; 3],
    /// Filament to push (or draw back), units of 0.1 nm.
    pub filament_100pm: i64,
    /// Speed along the path, of the filament where nothing else moves, mm/s.
    pub feed_mm_per_s: f32,
    /// Number of the source line.
    pub line: u32,
    /// Whether the line's move ends here.
    pub ends_move: bool,
}

/// Why motion was not taken. Nothing has changed then, but for [`Self::Plan`].
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MoveError {
    /// The look-ahead ring is full; try again when it is not.
    NoRoom,
    /// A coordinate is beyond 5 m, or a motor would run more than 2^28 steps.
    TooFar,
    /// More filament than one move may push.
    TooMuchFilament,
    /// The feed is not a number above zero.
    Feed,
    /// The motion was prepared, and its plan cannot be followed. What was taken before is executed as far as it can be
    /// trusted, to a standstill on the path, and no more of the job is taken until [`Planner::reset_to`] says where the
    /// motors are.
    Plan(PlanFault),
}

/// What became of motion that was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moved {
    /// It displaces nothing and was dropped.
    Nothing,
    /// It will be executed.
    Queued,
}

impl Request for Move {
    fn add_to<S: RingMemory, M: MotionMethods>(
        &self,
        planner: &mut Planner<S, M>,
        make_room: impl FnMut(&mut Planner<S, M>) -> bool,
    ) -> Result<Moved, MoveError> {
        if !planner.use_look_ahead() {
            return Err(MoveError::NoRoom);
        }
        let Self { filament_100pm, feed_mm_per_s, line, ends_move, .. } = *self;
        let target_10nm = narrow(self.target_10nm).ok_or(MoveError::TooFar)?;
        let corner_filament_100pm = filament_100pm;
        let travel = Travel { target_10nm, filament_100pm, corner_filament_100pm, feed_mm_per_s, line, ends_move };
        let Some(target) = planner.rules.target(&travel, &planner.position)? else { return Ok(Moved::Nothing) };
        let planned = planner.rules.plan(&travel, &target, &planner.previous);
        if !planner.flushing && planner.shares_blocks() && planner.open.absorb(&planned) {
            planner.tallies.merged_moves += 1;
        } else {
            planner.close_making_room(make_room)?;
            planner.open.begin(&planned, EntrySpeed::Bound, planned.nominal);
        }
        planner.advance_position(&target, &planned);
        Ok(Moved::Queued)
    }

    fn as_move(&self) -> Option<&Move> {
        Some(self)
    }
}
