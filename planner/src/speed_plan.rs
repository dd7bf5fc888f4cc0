//! Sources of the speeds of the blocks in the look-ahead ring, and how blocks come to
//! it and leave it.

use crate::block::{Block, PlannedBlock, Speed, SquaredSpeed};
use crate::motion_choice::AccelerationProfile;
use crate::pace::Pace;
use crate::pieces::Pieces;
use crate::ring::{Marker, Ring, RingMemory};
use crate::s_curve::Run;
use crate::s_curve::law::Curve;
use crate::time_law::TimeLaw;

/// Source of a move's planned entry speed.
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EntrySpeed {
    /// The move continues the block before it: the corner between them limits nothing, and both
    /// share one block.
    Continues,
    /// The most that the corner before it and both nominal speeds allow.
    Bound,
    /// The entry speed of the block before, slowed down over that block's whole length.
    Falling,
    /// Given by the plan: this squared speed.
    Given(SquaredSpeed),
}

/// Reason why the plan of a prepared job cannot be followed.
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanFault {
    /// The entry speed is above what the corner and the nominal speeds allow.
    TooFast {
        /// Planned entry speed.
        planned: Speed,
        /// The most that is allowed.
        maximum: Speed,
    },
    /// The block before cannot slow down to the entry speed.
    TooSlow {
        /// Planned entry speed.
        planned: Speed,
        /// The least to which the block before can slow down.
        minimum: Speed,
    },
    /// A block is faster than the machine's limits along its axes, or accelerates faster.
    BeyondLimits,
    /// A move that should continue the block before it turns, or has another speed or acceleration.
    NotContinued,
    /// The machine's acceleration profile is not the trapezoid of prepared jobs.
    NotTrapezoid(AccelerationProfile),
}

/// Start of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockStart {
    /// Bound of the speed by the corner before it.
    pub corner: Speed,
    /// Source of its entry speed; look-ahead finds it by itself.
    pub entry: EntrySpeed,
    /// The nominal speed that it was planned with. The block's own differs where the feed
    /// was changed since.
    pub nominal: Speed,
}

impl BlockStart {
    /// The start of a block that is planned here, after a corner with this bound.
    pub fn after_corner(corner: Speed, block: &Block) -> Self {
        Self { corner, entry: EntrySpeed::Bound, nominal: block.nominal }
    }
}

/// A block of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// The block.
    pub block: Block,
    /// The run that it is part of.
    pub run: Run,
    /// Start within the run, units of 10 nm.
    pub offset_10nm: u32,
}

impl Part {
    /// The law of the run along the block, and the speed at the block's end (Li 2017).
    pub fn law<P: Pieces>(&self) -> (TimeLaw<P>, Speed) {
        TimeLaw::along(&Curve::new(&self.run), self.offset_10nm, self.block.length_10nm)
    }
}

/// Item that leaves the ring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Released {
    /// A block with settled speeds.
    Block(PlannedBlock),
    /// A block of a run, under an S-curve.
    Part(Part),
    /// A marker.
    Marker(Marker),
}

/// Gives the blocks in a ring their speeds: [`crate::look_ahead::LookAhead`] plans them,
/// [`crate::given_speeds::GivenSpeeds`] takes those of a prepared job.
pub trait SpeedPlan {
    /// Adds a block to a ring that has room.
    ///
    /// # Errors
    /// The block's given speed cannot be followed. Nothing has changed then.
    fn push<S: RingMemory>(&mut self, ring: &mut Ring<S>, block: &Block, start: &BlockStart) -> Result<(), PlanFault>;

    /// Takes the oldest block or marker, which may leave. A block is held to the pace, as far as it
    /// can slow down to it on its own length.
    fn pop<S: RingMemory>(&mut self, ring: &mut Ring<S>, pace: Pace) -> Option<Released>;

    /// Takes note that the ring was emptied: the next block starts from standstill.
    fn clear(&mut self);
}
