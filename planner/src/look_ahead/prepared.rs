//! Blocks whose entry speeds were planned elsewhere, with all the look-ahead there is (Yu 2019: plan on the computer,
//! execute on the board).
//!
//! What they bring are upper bounds. The forward pass is made here as for any block, so a machine that has been slowed
//! down, or begins in the middle, follows the plan from below and meets it where acceleration lets it. There is no reverse
//! pass: in its place stands one sum. A block leaves with no more speed than all blocks behind it in the ring can take
//! away, so the machine can stop on the path whatever comes next, or does not come.

use super::{Content, Law, Left, LookAhead, Slot, Waiting};
use crate::block::{Block, PlannedBlock, Speed, SquaredSpeed};
use crate::pace::Pace;

/// Planned speed at a move's start.
// A word, where it would be two.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// The move continues the block before: no corner that anybody could tell lies between them.
    Continues,
    /// What the corner before it and both nominal speeds allow.
    Bound,
    /// What is left of the planned entry speed of the block before, slowed over its whole length.
    Falling,
    /// This squared speed.
    Given(SquaredSpeed),
}

/// Why a plan cannot be followed.
// A word, as the error that it is a part of.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Violation {
    /// The entry speed is above what the corner and the nominal speeds allow.
    TooFast,
    /// The block before cannot slow down to it.
    TooSlow,
    /// A block is faster than the machine's limits along its axes.
    BeyondLimits,
    /// A move is said to continue the block before, and does not.
    NotContinued,
}

/// The forward pass over planned speeds, before blocks enter the ring; whoever prepares a job makes the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pass {
    /// Planned entry of the newest block.
    planned: SquaredSpeed,
    /// What acceleration leaves of it.
    settled: SquaredSpeed,
    /// 2 a S of the block.
    reach: u64,
}

impl Pass {
    /// Takes the next block; returns its planned entry. At a standstill any plan will do, for nothing comes of it.
    ///
    /// # Errors
    /// The plan breaks the bound, or the block before would have to brake harder than it may. Nothing has changed then.
    pub fn next(
        &mut self,
        block: &Block,
        bound: SquaredSpeed,
        stopped: bool,
        entry: Entry,
    ) -> Result<SquaredSpeed, Violation> {
        self.next_over(block.reach(), bound, stopped, entry)
    }

    #[inline(always)]
    fn next_over(
        &mut self,
        reach: u64,
        bound: SquaredSpeed,
        stopped: bool,
        entry: Entry,
    ) -> Result<SquaredSpeed, Violation> {
        let planned = match entry {
            Entry::Bound => bound,
            // Where the machine was stopped inside a block, the rest of it is a block that falls on.
            Entry::Falling | Entry::Continues => self.planned.slowed_by(self.reach),
            Entry::Given(planned) => planned,
        };
        if stopped {
            *self = Self { planned, settled: SquaredSpeed::ZERO, reach };
            return Ok(SquaredSpeed::ZERO);
        }
        if planned > bound {
            return Err(Violation::TooFast);
        }
        self.go_on(reach, planned)
    }

    /// Takes a block that begins with this speed, which is no more than its bound.
    #[inline(always)]
    fn go_on(&mut self, reach: u64, planned: SquaredSpeed) -> Result<SquaredSpeed, Violation> {
        // All are below 2^63.
        let gain = planned.units().wrapping_sub(self.settled.units()).cast_signed();
        let most = self.reach.cast_signed();
        let mut settled = planned;
        if gain > most {
            settled = self.fastest();
        } else if gain.wrapping_add(most) < 0 && planned.root() < self.settled.slowed_by(self.reach).root() {
            // A speed that was rounded to its unit may be less by that.
            return Err(Violation::TooSlow);
        }
        *self = Self { planned, settled, reach };
        Ok(planned)
    }

    /// Largest squared speed at the end of the newest block.
    #[inline]
    pub fn fastest(&self) -> SquaredSpeed {
        self.settled.changed_by(self.reach)
    }
}

/// The state of a ring whose blocks bring their speeds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Prepared {
    pass: Pass,
    /// Sum of 2 a S over all blocks in the ring: the largest squared speed from which they can bring the machine to rest.
    reach: u64,
    /// Speed with which the last block left: the root of the ring's `left_with`.
    left: Speed,
}

/// How a block begins.
struct Start {
    entry: SquaredSpeed,
    /// The root of it, where it is known.
    root: Speed,
    /// Whether the block before has left.
    settled: bool,
}

impl Prepared {
    /// The oldest block leaves, which starts with this squared speed: the one at its end takes its place.
    #[inline(always)]
    fn leave(&mut self, squared: &mut SquaredSpeed, reach: u64, nominal: Speed, next: &Waiting) {
        self.reach = self.reach.saturating_sub(reach);
        let (planned, root) = (next.entry, next.run_entry);
        // Nearly always it is as planned. All are below 2^63.
        let gain = planned.units().wrapping_sub(squared.units()).cast_signed();
        let is_reached = gain <= reach.cast_signed();
        if is_reached && planned.units() <= self.reach && root > Speed::ZERO && root <= nominal {
            (self.left, *squared) = (root, planned);
        } else {
            self.left = self.slower(*squared, reach, nominal, planned);
            *squared = self.left.into();
        }
    }

    #[inline(never)]
    fn slower(&self, entry: SquaredSpeed, reach: u64, nominal: Speed, planned: SquaredSpeed) -> Speed {
        // A nominal speed that has been lowered is met as fast as the block can slow down to it.
        let held = SquaredSpeed::from(nominal).max(entry.slowed_by(reach));
        let most = planned.min(held).min(SquaredSpeed::from_units(self.reach));
        most.min(entry.changed_by(reach)).root()
    }
}

impl<S: AsRef<[Slot]> + AsMut<[Slot]>> LookAhead<S> {
    /// From now on blocks bring their speeds; for a ring that is empty.
    pub fn begin_prepared(&mut self) {
        self.law = Law::Prepared(Prepared::default());
    }

    /// Whether blocks bring their speeds.
    pub fn is_prepared(&self) -> bool {
        matches!(self.law, Law::Prepared(_))
    }

    /// Adds a block that brings its speed to a ring that has room and whose blocks bring theirs.
    ///
    /// `junction` is the speed bound of the corner before it, `nominal` the nominal speed that it was planned with; its own is
    /// another where the feed has been changed since.
    ///
    /// # Errors
    /// As [`Pass::next`].
    #[inline(always)]
    pub fn push_prepared(
        &mut self,
        block: &Block,
        nominal: Speed,
        junction: Speed,
        entry: Entry,
    ) -> Result<(), Violation> {
        let reach = block.reach();
        let bound = junction.min(nominal).min(self.newest_nominal);
        let squared = SquaredSpeed::from(bound);
        let Law::Prepared(prepared) = &mut self.law else { return Ok(()) };
        let start = if entry == Entry::Bound && !self.stopped && self.blocks > 0 {
            Start { entry: prepared.pass.go_on(reach, squared)?, root: bound, settled: false }
        } else {
            let planned = prepared.pass.next_over(reach, squared, self.stopped, entry)?;
            if self.blocks > 0 {
                Start { entry: planned, root: Speed::ZERO, settled: false }
            } else {
                Start { entry: self.left_with, root: prepared.left, settled: true }
            }
        };
        prepared.reach = prepared.reach.saturating_add(reach);
        self.stopped = false;
        self.newest_nominal = nominal;
        let Some(slot) = self.next_slot() else { return Ok(()) };
        // Nearly always a block was here before. What it has that a prepared one has not may stay.
        if !matches!(slot.0, Content::Block(_)) {
            slot.0 = Content::Block(Waiting::NONE);
        }
        if let Content::Block(waiting) = &mut slot.0 {
            waiting.block.become_block(block);
            waiting.entry = start.entry;
            waiting.run_entry = start.root;
            waiting.settled = start.settled;
        }
        self.length = self.length.wrapping_add(1);
        self.blocks = self.blocks.wrapping_add(1);
        Ok(())
    }

    /// As [`Self::pop`]; what is behind the block must be able to stop the machine.
    #[inline(never)]
    pub(super) fn pop_prepared(&mut self, pace: Pace) -> Option<Left> {
        let Law::Prepared(prepared) = &mut self.law else { return None };
        let slots = self.slots.as_ref();
        let Some(Slot(Content::Block(waiting))) = slots.get(self.first) else { return self.pop_marker() };
        let nominal = waiting.block.nominal;
        let capped = if pace == Pace::FULL { nominal } else { pace.of(nominal) };
        let left = self.length.wrapping_sub(1);
        let first = self.first.wrapping_add(1);
        let first = if first == slots.len() { 0 } else { first };
        let next = match slots.get(first) {
            Some(Slot(Content::Block(next))) if left > 0 => Some(next),
            _ => next_block(slots, first, left),
        };
        self.left_nominal = nominal;
        (self.first, self.length) = (first, left);
        self.blocks = self.blocks.wrapping_sub(1);
        if self.released > 0 {
            self.released -= 1;
        }
        let entry = prepared.left;
        match next {
            Some(next) => prepared.leave(&mut self.left_with, waiting.block.reach(), capped, next),
            None => {
                self.stopped = true;
                self.left_with = SquaredSpeed::ZERO;
                (prepared.reach, prepared.left) = (0, Speed::ZERO);
            }
        }
        let exit = prepared.left;
        let mut left = PlannedBlock { block: waiting.block, entry, exit };
        left.block.nominal = capped.max(entry).max(exit);
        Some(Left::Block(left))
    }

    /// The oldest place, which is no block's.
    #[inline(never)]
    fn pop_marker(&mut self) -> Option<Left> {
        match self.take_first()? {
            Content::Marker(marker) => Some(Left::Marker(marker)),
            Content::Block(_) | Content::Empty => None,
        }
    }

    /// Squared entry speed of the last block that left as the reverse pass had it, and its bound by the corner and both
    /// nominal speeds: what somebody writes down who prepares a job. Under trapezoids.
    pub fn left_entry(&self) -> (SquaredSpeed, SquaredSpeed) {
        (self.left_entry, self.left_bound)
    }
}

/// The oldest block of so many places, which is behind markers, or none.
#[cold]
#[inline(never)]
fn next_block(slots: &[Slot], first: usize, length: usize) -> Option<&Waiting> {
    let (behind, before) = slots.split_at_checked(first)?;
    before.iter().chain(behind).take(length).find_map(|slot| match &slot.0 {
        Content::Block(waiting) => Some(waiting),
        Content::Empty | Content::Marker(_) => None,
    })
}
