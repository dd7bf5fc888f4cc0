//! A trajectory as a request to the planner.

use ferrostep_planner::look_ahead::{PlanFault, RingMemory};
use ferrostep_planner::stretches::Stretches;
use ferrostep_planner::{Block, MotionMethods, MoveError, Moved, Planner, Request, Speed};

use super::step_limits::{StepLimits, StepSizes, part};

/// A trajectory as a block, with the data needed to check it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreparedBlock {
    /// The block.
    pub block: Block,
    /// Planned speed at the start of the block.
    pub entry: Speed,
    /// Maximum speed that the corner before the block allows.
    pub max_entry: Speed,
    /// Last stretch of the previous block, for the corner between them; `None` at the start of a
    /// job.
    pub before: Option<Block>,
}

impl PreparedBlock {
    /// Last stretch of this block, for the `before` of the next one.
    pub(super) fn last_stretch(&self) -> Option<Block> {
        Stretches::of(&self.block).last().map(|stretch| part(&self.block, &stretch))
    }

    /// Returns the largest speed that the corner before the block allows.
    fn check(&self, limits: &StepLimits<'_>) -> Result<Speed, PlanFault> {
        let (mut first, mut inner) = (Speed(u32::MAX), Speed(u32::MAX));
        let mut before = self.before;
        for stretch in Stretches::of(&self.block) {
            let part = part(&self.block, &stretch);
            if !limits.are_kept(&part) {
                return Err(PlanFault::BeyondLimits);
            }
            let corner = limits.corner(before.as_ref(), &part);
            if stretch.before_10nm == 0 {
                first = corner;
            } else {
                inner = inner.min(corner);
            }
            before = Some(part);
        }
        let planned = self.block.nominal;
        if inner < planned {
            return Err(PlanFault::TooFast { planned, maximum: inner });
        }
        Ok(first.min(self.max_entry))
    }
}

/// Request for a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockRequest<'a> {
    pub prepared: &'a PreparedBlock,
    pub sizes: &'a StepSizes,
}

impl Request for BlockRequest<'_> {
    fn add_to<S: RingMemory, M: MotionMethods>(
        &self,
        planner: &mut Planner<S, M>,
        make_room: impl FnMut(&mut Planner<S, M>) -> bool,
    ) -> Result<Moved, MoveError> {
        let PreparedBlock { block, entry, .. } = self.prepared;
        planner.add_given_block(block, *entry, make_room, |planner| {
            self.prepared.check(&StepLimits::new(
                self.sizes,
                planner.limits(),
                planner.geometry(),
                planner.motion_choice(),
            ))
        })
    }
}

/// Request to set the exact position, units of 10 nm, since blocks give it only to a motor step.
/// The planner's position is unchanged if the motors are elsewhere.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExactPosition(pub [i64; 3]);

impl Request for ExactPosition {
    fn add_to<S: RingMemory, M: MotionMethods>(
        &self,
        planner: &mut Planner<S, M>,
        _: impl FnMut(&mut Planner<S, M>) -> bool,
    ) -> Result<Moved, MoveError> {
        planner.refine_position(self.0);
        Ok(Moved::Nothing)
    }
}
