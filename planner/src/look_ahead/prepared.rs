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

/// The planned squared speed at a block's start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// What its corner and both nominal speeds allow.
    Bound,
    /// What is left of the speed planned for the block before, slowed over its whole length.
    Falling,
    /// This one.
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
    /// Planned for the end of the newest block, were it braked from its planned entry.
    falling: SquaredSpeed,
    /// Largest and smallest at its end that acceleration allows.
    fastest: SquaredSpeed,
    slowest: SquaredSpeed,
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
            Entry::Falling => self.falling,
            Entry::Given(planned) => planned,
        };
        let mut settled = SquaredSpeed::ZERO;
        if !stopped {
            if planned > bound {
                return Err(Violation::TooFast);
            }
            // A speed that was rounded to its unit may be less by that.
            if planned < self.slowest && planned.root() < self.slowest.root() {
                return Err(Violation::TooSlow);
            }
            settled = planned.min(self.fastest);
        }
        self.falling = planned.slowed_by(reach);
        self.fastest = settled.changed_by(reach);
        self.slowest = settled.slowed_by(reach);
        Ok(if stopped { SquaredSpeed::ZERO } else { planned })
    }

    /// Largest squared speed at the end of the newest block.
    pub fn fastest(&self) -> SquaredSpeed {
        self.fastest
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

impl<S: AsRef<[Slot]> + AsMut<[Slot]>> LookAhead<S> {
    /// From now on blocks bring their speeds; for a ring that is empty.
    pub fn begin_prepared(&mut self) {
        self.law = Law::Prepared(Prepared::default());
    }

    /// Whether blocks bring their speeds.
    pub fn is_prepared(&self) -> bool {
        matches!(self.law, Law::Prepared(_))
    }

    /// Adds a block that brings its speed; `Ok(false)` without room, or where blocks bring none.
    ///
    /// `junction` is the squared speed bound of the corner before it, `planned_nominal` the nominal speed that the plan was
    /// made with; `nominal`, in the place of the block's own, may be another, if the feed has been changed since.
    ///
    /// # Errors
    /// As [`Pass::next`].
    #[inline(always)]
    pub fn push_prepared(
        &mut self,
        block: &Block,
        nominal: Speed,
        planned_nominal: Speed,
        junction: SquaredSpeed,
        entry: Entry,
    ) -> Result<bool, Violation> {
        if !self.has_room() {
            return Ok(false);
        }
        let Law::Prepared(prepared) = &mut self.law else { return Ok(false) };
        let reach = block.reach();
        let squared = SquaredSpeed::from(planned_nominal);
        let bound = junction.min(squared).min(self.newest_nominal);
        let planned = prepared.pass.next_over(reach, bound, self.stopped, entry)?;
        prepared.reach = prepared.reach.saturating_add(reach);
        self.stopped = false;
        self.newest_nominal = squared;
        let settled = self.blocks == 0;
        let entry = if settled { self.left_with } else { planned };
        // Here the bound is that of the nominal speed: the corner has been looked at.
        let entry_bound = if nominal == planned_nominal { squared } else { nominal.into() };
        let (run_bound, run_entry, anchor) = (Speed::ZERO, Speed::ZERO, 0);
        let block = Block { nominal, ..*block };
        self.place_block(Waiting { block, entry_bound, entry, settled, run_bound, run_entry, anchor });
        Ok(true)
    }

    /// As [`Self::pop`]; what is behind the block must be able to stop the machine.
    #[inline(never)]
    pub(super) fn pop_prepared(&mut self, pace: Pace) -> Option<Left> {
        let slots = self.slots.as_ref();
        let waiting = match &slots.get(self.first)?.0 {
            Content::Empty => {
                self.pass_first();
                return None;
            }
            Content::Marker(marker) => {
                let marker = *marker;
                self.pass_first();
                return Some(Left::Marker(marker));
            }
            Content::Block(waiting) => waiting,
        };
        let Law::Prepared(prepared) = &mut self.law else { return None };
        let reach = waiting.block.reach();
        let nominal = waiting.block.nominal;
        let behind = prepared.reach.saturating_sub(reach);
        prepared.reach = behind;
        // What the oldest block starts with is what the one before has left with.
        let (entry, squared) = (prepared.left, self.left_with);
        let (capped, capped_squared) = if pace == Pace::FULL {
            (nominal, waiting.entry_bound)
        } else {
            let capped = pace.of(nominal);
            (capped, capped.into())
        };
        let reachable = squared.changed_by(reach).min(capped_squared.max(squared.slowed_by(reach)));
        let reachable = reachable.min(SquaredSpeed::from_units(behind));
        self.left_nominal = nominal;
        self.blocks = self.blocks.saturating_sub(1);
        let next = self.first + 1;
        self.first = if next == slots.len() { 0 } else { next };
        self.length = self.length.saturating_sub(1);
        self.released = self.released.saturating_sub(1);
        let next_entry = match slots.get(self.first) {
            Some(Slot(Content::Block(next))) if self.length > 0 => Some(next.entry),
            _ => next_entry(slots, self.first, self.length),
        };
        let exit = match next_entry {
            Some(next) => next.min(reachable).root(),
            None => {
                self.stopped = true;
                Speed::ZERO
            }
        };
        self.left_with = exit.into();
        prepared.left = exit;
        let nominal = capped.max(entry).max(exit);
        Some(Left::Block(PlannedBlock { block: Block { nominal, ..waiting.block }, entry, exit }))
    }

    /// Squared entry speed of the last block that left as the reverse pass had it, and its bound by the corner and both
    /// nominal speeds: what somebody writes down who prepares a job. Under trapezoids.
    pub fn left_entry(&self) -> (SquaredSpeed, SquaredSpeed) {
        (self.left_entry, self.left_bound)
    }
}

/// The planned entry of the oldest block of so many places, which is behind markers, or none.
#[cold]
#[inline(never)]
fn next_entry(slots: &[Slot], first: usize, length: usize) -> Option<SquaredSpeed> {
    let (behind, before) = slots.split_at_checked(first)?;
    before.iter().chain(behind).take(length).find_map(|slot| match &slot.0 {
        Content::Block(waiting) => Some(waiting.entry),
        Content::Empty | Content::Marker(_) => None,
    })
}
