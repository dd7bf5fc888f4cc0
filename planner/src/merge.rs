//! Moves that continue each other share one block.
//!
//! Slicers cut curves, and at times straight lines, into moves of a few hundredths of a mm. Were each to take a place of
//! the look-ahead ring, the ring would see only millimetres ahead, and the machine could only be as fast as it can stop
//! within those. So the newest block stays open, outside the ring, until the next move is there, and takes it in if the
//! corner between them limits nothing and both want the same speed and acceleration. Look-ahead and time law then see one
//! path; the steps are made move by move ([`crate::inner_ends`]), so every motor ends every move exactly where it ends
//! without the sharing.

use crate::block::{Block, Speed};
use crate::inner_ends::InnerEnd;
use crate::junction::Pull;
use crate::path::Path;

/// Longest block of several moves, units of 10 nm: what an inner end's place can tell.
const LONGEST_10NM: u32 = u16::MAX as u32;

/// Most filament that a move pushes in a block that it shares, 1/256 steps: an eighth of what an inner end can hold, so
/// that a job that was prepared can be printed with eight times its flow (M221).
const MOST_EXTRUDER_256THS: u32 = i16::MAX as u32 / 8;

/// A move planned by itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Planned {
    /// Its block.
    pub block: Block,
    /// Most step events that it has, the extruder's among them.
    pub events: f32,
    /// Bound of the speed at its start, by the corner there.
    pub junction: Speed,
    /// Its path.
    pub path: Path,
    /// Its acceleration, as its corners see it; zero where the filament moves alone.
    pub pull: Pull,
}

/// The newest block, which may still grow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Open {
    /// The moves so far as one block.
    pub block: Block,
    /// Most step events that it has, the extruder's among them.
    pub events: f32,
    /// Bound of the speed at its start.
    pub junction: Speed,
    /// Number of moves in it; 0 where no block is open.
    pub moves: u32,
    /// What the last of its moves adds to the block.
    last_steps: [i32; 3],
    last_extruder_256ths: i32,
}

impl Open {
    /// No block.
    pub const NONE: Self = Self {
        block: Block::NONE,
        events: 0.0,
        junction: Speed::ZERO,
        moves: 0,
        last_steps: [0; 3],
        last_extruder_256ths: 0,
    };

    /// Whether there is a block.
    pub fn is_some(&self) -> bool {
        self.moves > 0
    }

    /// A block of one move.
    #[inline(always)]
    pub fn begin(&mut self, planned: &Planned) {
        self.block.become_block(&planned.block);
        self.events = planned.events;
        self.junction = planned.junction;
        self.moves = 1;
        self.last_steps = self.block.steps;
        self.last_extruder_256ths = self.block.extruder_256ths;
    }

    /// Forgets the block.
    pub fn clear(&mut self) {
        self.moves = 0;
    }

    /// Takes the next move in, where that changes neither speeds nor steps: same nominal speed and acceleration, and a
    /// corner that limits neither. Moves of the filament alone have a stop beside them.
    pub fn absorb(&mut self, next: &Planned) -> bool {
        let most = self.last_extruder_256ths.unsigned_abs().max(next.block.extruder_256ths.unsigned_abs());
        self.continues(next) && most <= MOST_EXTRUDER_256THS && self.join(next)
    }

    /// The same for a move whose plan says that it continues the block. How much filament goes with it may have changed since.
    pub fn absorb_prepared(&mut self, next: &Planned) -> bool {
        self.continues(next) && self.join(next)
    }

    #[inline]
    fn continues(&self, next: &Planned) -> bool {
        // The commonest reasons against it come first.
        self.block.length_10nm.saturating_add(next.block.length_10nm) <= LONGEST_10NM
            && self.is_some()
            && next.block.nominal == self.block.nominal
            && next.block.acceleration == self.block.acceleration
            && next.junction >= self.block.nominal
    }

    /// Makes the next move a part of the block; `false`, and nothing has changed, if it does not fit.
    fn join(&mut self, next: &Planned) -> bool {
        let block = &mut self.block;
        let end = InnerEnd {
            length_10nm: block.length_10nm,
            steps: self.last_steps,
            extruder_256ths: self.last_extruder_256ths,
            line: block.line,
            ends_move: block.ends_move,
        };
        let Some(inner_ends) = block.inner_ends.with(end, next.block.line) else { return false };
        let Some(steps) = sums(block.steps, next.block.steps) else { return false };
        let Some(extruder_256ths) = block.extruder_256ths.checked_add(next.block.extruder_256ths) else { return false };
        block.steps = steps;
        block.extruder_256ths = extruder_256ths;
        // At most 0.65 mm.
        block.length_10nm = block.length_10nm.saturating_add(next.block.length_10nm);
        block.line = next.block.line;
        block.ends_move = next.block.ends_move;
        block.inner_ends = inner_ends;
        self.last_steps = next.block.steps;
        self.last_extruder_256ths = next.block.extruder_256ths;
        self.events += next.events;
        self.moves += 1;
        true
    }
}

/// Sums of the components, where they are in range.
fn sums(one: [i32; 3], other: [i32; 3]) -> Option<[i32; 3]> {
    let ([x, y, z], [dx, dy, dz]) = (one, other);
    Some([x.checked_add(dx)?, y.checked_add(dy)?, z.checked_add(dz)?])
}
