//! Recording of a prepared job: the blocks that leave look-ahead, with their planned speeds.

use super::Planner;
use crate::block::{PlannedBlock, SquaredSpeed};
use crate::methods::MotionMethods;
use crate::ring::{Marker, RingMemory};
use crate::speed_plan::Released;

/// A block or marker that left look-ahead, as a prepared job needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Recorded {
    /// A block.
    Block {
        /// The block and its speeds.
        planned: PlannedBlock,
        /// Squared entry speed from the reverse pass.
        entry: SquaredSpeed,
        /// Limit set by the corner and both nominal speeds.
        bound: SquaredSpeed,
    },
    /// A fan changes.
    FanPower {
        /// Number of the fan.
        fan: u8,
        /// Power, 0 to 255.
        power: u8,
    },
}

/// Takes what leaves look-ahead and notes the entry speeds that the reverse pass has found, before
/// acceleration lowers them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Recorder {
    /// Planned entry of the next block.
    entry: SquaredSpeed,
}

impl Recorder {
    /// Takes what may leave look-ahead next, without making its steps.
    pub fn next<S: RingMemory, M: MotionMethods>(&mut self, planner: &mut Planner<S, M>) -> Option<Recorded> {
        loop {
            let notes = planner.queue.oldest_bound_and_next_entry();
            let released = planner.release_next()?;
            if let Released::Marker(Marker::FanPower { fan, power }) = released {
                return Some(Recorded::FanPower { fan, power });
            }
            // A player of the job advances by its commands.
            let Some(planned) = planner.pass_over(&released) else { continue };
            let (entry, bound) = match (released, notes) {
                (Released::Block(_), Some((bound, next))) => (core::mem::replace(&mut self.entry, next), bound),
                _ => (planned.entry.into(), planned.entry.into()),
            };
            return Some(Recorded::Block { planned, entry, bound });
        }
    }
}
