//! Moves that continue each other share one block.
//!
//! Slicers cut curves, and at times straight lines, into moves of a few hundredths of a mm.
//! Were each to take a place of the look-ahead ring, the ring would see only millimetres
//! ahead, and the machine could only be as fast as it can stop within those. So the newest
//! block stays open, outside the ring, until the next move is there, and takes it in if the
//! corner between them limits nothing and both want the same speed and acceleration. One that
//! is too long for that enters at once. Look-ahead and time law then see one path; the steps
//! are made move by move ([`crate::inner_ends`]), so every motor ends every move exactly where
//! it ends without the sharing.

use crate::block::{Acceleration, Block, Speed};
use crate::budget::Budget;
use crate::inner_ends::{InnerEnd, MAX_EXTRUDER_256THS, MAX_LENGTH_10NM};
use crate::planner::block_rules::Planned;
use crate::speed_plan::{BlockStart, EntrySpeed};

/// A block that enters the ring.
pub(crate) struct Closing<'a> {
    pub block: &'a Block,
    pub start: BlockStart,
    /// Moves that the budget has made slower than planned.
    pub slowed_moves: u32,
}

/// The newest block, which may still grow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OpenBlock {
    /// The moves so far as one block.
    block: Block,
    /// Maximum number of step events of the block, the extruder's among them.
    events: f32,
    /// Bound of the speed at its start.
    corner: Speed,
    /// Source of its entry speed.
    entry: EntrySpeed,
    /// Nominal speed at the present feed, which may differ from the feed of a prepared job's plan.
    nominal_now: Speed,
    /// Number of moves in it; 0 where no block is open.
    moves: u32,
    /// Steps that the last of its moves adds to the block.
    last_steps: [i32; 3],
    last_extruder_256ths: i32,
    /// The acceleration as all but the corner at its end leave it.
    acceleration_before_end: Acceleration,
    /// The corner at its end has lowered the acceleration as far as it must.
    is_end_known: bool,
}

impl OpenBlock {
    /// No block.
    pub const NONE: Self = Self {
        block: Block::NONE,
        events: 0.0,
        corner: Speed::ZERO,
        entry: EntrySpeed::Bound,
        nominal_now: Speed::ZERO,
        moves: 0,
        last_steps: [0; 3],
        last_extruder_256ths: 0,
        acceleration_before_end: Block::NONE.acceleration,
        is_end_known: false,
    };

    /// True if there is a block.
    pub fn is_some(&self) -> bool {
        self.moves > 0
    }

    /// True if it is too long to take another move.
    pub fn is_full(&self) -> bool {
        self.is_some() && self.block.length_10nm >= MAX_LENGTH_10NM
    }

    /// Becomes a block of one move; `nominal_now` is its nominal speed at the present feed.
    #[inline(always)]
    pub fn begin(&mut self, planned: &Planned, entry: EntrySpeed, nominal_now: Speed) {
        let Planned { steps, extruder_256ths, length_10nm, nominal, acceleration, line, ends_move, .. } = *planned;
        let block = &mut self.block;
        (block.steps, block.extruder_256ths) = (steps, extruder_256ths);
        (block.length_10nm, block.nominal, block.acceleration) = (length_10nm, nominal, acceleration);
        (block.line, block.ends_move) = (line, ends_move);
        block.inner_ends.clear();
        self.events = planned.events;
        self.corner = planned.corner;
        self.entry = entry;
        self.nominal_now = nominal_now;
        self.moves = 1;
        self.last_steps = steps;
        self.last_extruder_256ths = extruder_256ths;
        self.acceleration_before_end = acceleration;
        self.is_end_known = false;
    }

    /// Acceleration of the open block before the corner at its end limits it; without an open block
    /// that of the last one.
    pub fn acceleration_before_end(&self) -> Acceleration {
        if self.is_some() { self.acceleration_before_end } else { self.block.acceleration }
    }

    /// Nominal speed of the open block, or of the last one.
    pub fn nominal(&self) -> Speed {
        self.block.nominal
    }

    /// Limits the acceleration to what the corner at its end, which may become another one, allows.
    pub fn hold_end_to(&mut self, acceleration: Acceleration) {
        if self.is_some() {
            self.block.acceleration = self.acceleration_before_end.min(acceleration);
            self.is_end_known = true;
        }
    }

    /// True if the corner at its end is known.
    pub fn is_end_known(&self) -> bool {
        self.is_end_known
    }

    /// Holds the block to what the processor can keep up with.
    #[inline(always)]
    pub fn hold_to(&mut self, budget: &Budget) -> Closing<'_> {
        let Self { block, events, corner, entry, nominal_now, moves, .. } = self;
        let cost = budget.cost(block, *events, *moves);
        let (mut nominal, mut slowed_moves) = (block.nominal, 0);
        let is_as_planned = *nominal_now == nominal;
        if let Some(slower) = cost.slower_nominal(nominal) {
            (nominal, slowed_moves) = (slower, *moves);
        }
        block.nominal = if is_as_planned { nominal } else { cost.slower_nominal(*nominal_now).unwrap_or(*nominal_now) };
        Closing { block, start: BlockStart { corner: *corner, entry: *entry, nominal }, slowed_moves }
    }

    /// The bound of the speed at its start, where nothing that may still join it lowers that.
    pub fn lasting_corner(&self, budget: &Budget) -> Option<Speed> {
        let corner = self.corner.min(self.block.nominal);
        budget.always_allows(corner, &self.block, self.events).then_some(corner)
    }

    /// The moves so far, if there is a block.
    pub fn block(&self) -> Option<&Block> {
        self.is_some().then_some(&self.block)
    }

    /// Forgets the block.
    pub fn clear(&mut self) {
        self.moves = 0;
    }

    /// Takes the next move in, where that changes neither speeds nor steps: same nominal speed
    /// and acceleration, and a corner that limits neither. Moves of the filament alone have a
    /// stop beside them.
    pub fn absorb(&mut self, next: &Planned) -> bool {
        let nominal_now = next.nominal;
        let most = self.last_extruder_256ths.unsigned_abs().max(next.extruder_256ths.unsigned_abs());
        self.continues(next) && most <= MAX_EXTRUDER_256THS && self.join(next, nominal_now)
    }

    /// Version of [`Self::absorb`] for a move whose plan says that it continues the block. Its
    /// filament may have changed since.
    pub fn absorb_prepared(&mut self, next: &Planned, nominal_now: Speed) -> bool {
        self.continues(next) && self.join(next, nominal_now)
    }

    #[inline]
    fn continues(&self, next: &Planned) -> bool {
        // The commonest reasons against it come first.
        self.block.length_10nm.saturating_add(next.length_10nm) <= MAX_LENGTH_10NM
            && self.is_some()
            && next.nominal == self.block.nominal
            && next.acceleration == self.block.acceleration
            && next.corner >= self.block.nominal
    }

    /// Makes the next move a part of the block; `false`, and nothing has changed, if
    /// it does not fit.
    fn join(&mut self, next: &Planned, nominal_now: Speed) -> bool {
        let block = &mut self.block;
        let end = InnerEnd {
            length_10nm: block.length_10nm,
            steps: self.last_steps,
            extruder_256ths: self.last_extruder_256ths,
            line: block.line,
            ends_move: block.ends_move,
        };
        let Some(inner_ends) = block.inner_ends.with(end, next.line) else { return false };
        let Some(steps) = sums(block.steps, next.steps) else { return false };
        let Some(extruder_256ths) = block.extruder_256ths.checked_add(next.extruder_256ths) else { return false };
        block.steps = steps;
        block.extruder_256ths = extruder_256ths;
        // Both lengths together are at most 0.65 mm.
        block.length_10nm = block.length_10nm.saturating_add(next.length_10nm);
        block.line = next.line;
        block.ends_move = next.ends_move;
        block.inner_ends = inner_ends;
        self.last_steps = next.steps;
        self.last_extruder_256ths = next.extruder_256ths;
        self.acceleration_before_end = self.block.acceleration;
        self.is_end_known = false;
        self.nominal_now = self.nominal_now.min(nominal_now);
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
