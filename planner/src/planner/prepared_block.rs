//! Blocks of prepared jobs, for formats that have blocks and no moves.
//!
//! A block comes without the positions it was made from: its limits and its corner are checked as far as its steps can tell.

use super::{MoveError, Moved, Planner, Request};
use crate::block::{Block, Speed};
use crate::given_speeds::{EntrySpeed, PlanFault};
use crate::inner_ends::Stretches;
use crate::junction::CornerAcceleration;
use crate::kinematics::narrow;
use crate::look_ahead::BlockStart;
use crate::methods::MotionMethods;
use crate::ring::RingMemory;

/// A block of a prepared job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreparedBlock {
    /// The block.
    pub block: Block,
    /// Planned speed at its start.
    pub entry: Speed,
    /// The most that the corner before it allows.
    pub max_entry: Speed,
    /// The last stretch of the block before, for the corner between them; `None` at the start of a job.
    pub before: Option<Block>,
}

impl PreparedBlock {
    /// The last stretch of this block, as the next one's `before`.
    pub fn last_stretch(&self) -> Option<Block> {
        Stretches::of(&self.block).last().map(|stretch| self.block.part(&stretch))
    }
}

/// What the steps of a block tell of its corners.
struct Corners {
    /// Bound of the speed at its start.
    first: Speed,
    /// The slowest of those inside.
    inner: Speed,
}

impl Request for PreparedBlock {
    fn add_to<S: RingMemory, M: MotionMethods>(
        &self,
        planner: &mut Planner<S, M>,
        make_room: impl FnMut(&mut Planner<S, M>) -> bool,
    ) -> Result<Moved, MoveError> {
        planner.use_given_speeds()?;
        planner.close_making_room(make_room)?;
        let Self { block, entry, max_entry, .. } = self;
        let mut motor_steps = planner.position.motor_steps;
        for (position, steps) in motor_steps.iter_mut().zip(block.steps) {
            *position = position.checked_add(steps).ok_or(MoveError::TooFar)?;
        }
        let position_10nm = planner.rules.geometry.position_10nm(motor_steps.map(i64::from));
        let Some(coordinates_10nm) = narrow(position_10nm) else { return Err(MoveError::TooFar) };
        let Some(corners) = self.corners(planner) else { return Err(planner.fail(PlanFault::BeyondLimits)) };
        if corners.inner < block.nominal {
            let (planned, maximum) = (block.nominal, corners.inner);
            return Err(planner.fail(PlanFault::TooFast { planned, maximum }));
        }
        let corner = corners.first.min(*max_entry);
        let entry = EntrySpeed::Given((*entry).into());
        if !planner.queue.push(block, &BlockStart { corner, entry, nominal: block.nominal }) {
            return Err(MoveError::NoRoom);
        }
        planner.check_plan()?;
        planner.previous.acceleration = CornerAcceleration::ZERO;
        planner.position.extruder.advance_256ths(block.extruder_256ths);
        planner.position.coordinates_10nm = coordinates_10nm;
        planner.position.motor_steps = motor_steps;
        Ok(Moved::Queued)
    }
}

impl PreparedBlock {
    /// The bounds of the corners before the block and inside it; `None` if the block is beyond the limits of an axis.
    fn corners<S: RingMemory, M: MotionMethods>(&self, planner: &Planner<S, M>) -> Option<Corners> {
        let mut corners = Corners { first: Speed(u32::MAX), inner: Speed(u32::MAX) };
        let mut before = self.before;
        for stretch in Stretches::of(&self.block) {
            let part = self.block.part(&stretch);
            if !planner.rules.keeps_limits(&part) {
                return None;
            }
            let corner = planner.rules.corner_of_steps(before.as_ref(), &part);
            if stretch.before_10nm == 0 {
                corners.first = corner;
            } else {
                corners.inner = corners.inner.min(corner);
            }
            before = Some(part);
        }
        Some(corners)
    }
}
