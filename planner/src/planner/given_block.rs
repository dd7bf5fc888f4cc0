//! The seam for formats whose jobs have blocks and no moves: a block that was made elsewhere, with
//! its planned entry speed.

use super::Planner;
use super::move_error::{MoveError, Moved};
use crate::block::{Block, Speed};
use crate::junction::CornerAcceleration;
use crate::kinematics::narrow;
use crate::methods::MotionMethods;
use crate::ring::RingMemory;
use crate::speed_plan::{BlockStart, EntrySpeed, PlanFault};

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// Takes a block of a prepared job; for an implementation of [`crate::Request`]. `make_room`
    /// as in [`Self::add_making_room`]. The planner knows no positions of such a block, so
    /// `check` answers for its limits and corners: it returns the largest speed that the corner
    /// before the block allows.
    ///
    /// # Errors
    /// See [`MoveError`]; the fault that `check` found ends the job as any [`MoveError::Plan`].
    pub fn add_given_block(
        &mut self,
        block: &Block,
        entry: Speed,
        make_room: impl FnMut(&mut Self) -> bool,
        check: impl FnOnce(&Self) -> Result<Speed, PlanFault>,
    ) -> Result<Moved, MoveError> {
        self.use_given_speeds()?;
        self.close_making_room(make_room)?;
        let mut motor_steps = self.position.motor_steps;
        for (position, steps) in motor_steps.iter_mut().zip(block.steps) {
            *position = position.checked_add(steps).ok_or(MoveError::TooFar)?;
        }
        let position_10nm = self.rules.geometry.position_10nm(motor_steps.map(i64::from));
        let Some(coordinates_10nm) = narrow(position_10nm) else { return Err(MoveError::TooFar) };
        let corner = match check(self) {
            Ok(corner) => corner,
            Err(fault) => return Err(self.fail(fault)),
        };
        let entry = EntrySpeed::Given(entry.into());
        if !self.queue.push(block, &BlockStart { corner, entry, nominal: block.nominal }) {
            return Err(MoveError::NoRoom);
        }
        self.check_plan()?;
        self.previous.acceleration = CornerAcceleration::ZERO;
        self.position.extruder.advance_256ths(block.extruder_256ths);
        self.position.coordinates_10nm = coordinates_10nm;
        self.position.motor_steps = motor_steps;
        Ok(Moved::Queued)
    }

    /// Makes this the position, units of 10 nm, if it agrees with the motors' steps: blocks give it
    /// to a motor step only. Returns true if it agrees.
    pub fn refine_position(&mut self, position_10nm: [i64; 3]) -> bool {
        let Some(coordinates_10nm) = narrow(position_10nm) else { return false };
        let stands = self.rules.geometry.motor_steps(position_10nm) == self.position.motor_steps;
        if stands {
            self.position.coordinates_10nm = coordinates_10nm;
        }
        stands
    }
}
