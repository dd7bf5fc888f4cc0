//! The outcome of a request for motion.

use crate::speed_plan::PlanFault;

/// Reason why motion was not taken. Nothing has changed, but for [`Self::Plan`].
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MoveError {
    /// The look-ahead ring is full; try again when it is not.
    NoRoom,
    /// A coordinate is beyond 5 m, or a motor would run more than 2^28 steps.
    TooFar,
    /// The move pushes more filament than one move may.
    TooMuchFilament,
    /// The feed is not a number above zero.
    Feed,
    /// The motion was prepared, and its plan cannot be followed. What was taken before is executed
    /// as far as it can be trusted, to a standstill on the path, and no more of the job is taken
    /// until [`crate::Planner::reset_to`] says where the motors are.
    Plan(PlanFault),
}

/// The outcome of a request that was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moved {
    /// The move has no length and was dropped.
    Nothing,
    /// The move will be executed.
    Queued,
}
