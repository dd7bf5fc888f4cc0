//! Entry speeds planned elsewhere, with unlimited look-ahead (Yu 2019: plan on the computer,
//! execute on the board).
//!
//! Given speeds are upper bounds. The forward pass is made here as for any block, so a machine that
//! was slowed down, or that begins in the middle, follows the plan from below and meets it where
//! acceleration permits. One sum replaces the reverse pass: a block leaves with no more speed than
//! all blocks after it in the ring can take away, so the machine can stop on the path whatever
//! comes next, or if nothing comes.

use crate::block::{Block, PlannedBlock, Speed, SquaredSpeed};
use crate::pace::Pace;
use crate::ring::{Content, Ring, RingMemory, Waiting};
use crate::speed_plan::{BlockStart, EntrySpeed, PlanFault, Released, SpeedPlan};

/// The forward pass over planned speeds, before blocks enter the ring; a job's writer makes the
/// same pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ForwardPass {
    /// Planned entry of the newest block.
    planned: SquaredSpeed,
    /// Planned speed, as far as acceleration permits.
    settled: SquaredSpeed,
    /// 2 a S of the block.
    reach: u64,
}

impl ForwardPass {
    /// Takes the next block; returns its planned entry. At standstill any plan is valid, because
    /// the block starts at zero.
    ///
    /// # Errors
    /// The plan exceeds the bound, or the previous block would have to brake too hard. Nothing has
    /// then changed.
    pub fn next(
        &mut self,
        block: &Block,
        bound: SquaredSpeed,
        stopped: bool,
        entry: EntrySpeed,
    ) -> Result<SquaredSpeed, PlanFault> {
        self.next_over(block.reach(), bound, stopped, entry)
    }

    #[inline(always)]
    fn next_over(
        &mut self,
        reach: u64,
        bound: SquaredSpeed,
        stopped: bool,
        entry: EntrySpeed,
    ) -> Result<SquaredSpeed, PlanFault> {
        let planned = match entry {
            EntrySpeed::Bound => bound,
            // The machine was stopped inside a block: the rest of the block keeps slowing down.
            EntrySpeed::Falling | EntrySpeed::Continues => self.planned.slowed_by(self.reach),
            EntrySpeed::Given(planned) => planned,
        };
        if stopped {
            *self = Self { planned, settled: SquaredSpeed::ZERO, reach };
            return Ok(SquaredSpeed::ZERO);
        }
        if planned > bound {
            return Err(PlanFault::TooFast { planned: planned.root(), maximum: bound.root() });
        }
        self.enter(reach, planned)
    }

    /// Takes a block that begins with this speed, which must not exceed its bound.
    #[inline(always)]
    fn enter(&mut self, reach: u64, planned: SquaredSpeed) -> Result<SquaredSpeed, PlanFault> {
        // All are below 2^63.
        let gain = planned.units().wrapping_sub(self.settled.units()).cast_signed();
        let most = self.reach.cast_signed();
        let mut settled = planned;
        if gain > most {
            settled = self.fastest();
        } else if gain.wrapping_add(most) < 0 {
            self.check_braking(planned)?;
        }
        *self = Self { planned, settled, reach };
        Ok(planned)
    }

    /// Checks the braking to a planned speed, which may be too low by its rounding.
    #[cold]
    #[inline(never)]
    fn check_braking(&self, planned: SquaredSpeed) -> Result<(), PlanFault> {
        let (planned, minimum) = (planned.root(), self.settled.slowed_by(self.reach).root());
        if planned < minimum { Err(PlanFault::TooSlow { planned, minimum }) } else { Ok(()) }
    }

    /// Largest squared speed at the end of the newest block.
    #[inline]
    pub fn fastest(&self) -> SquaredSpeed {
        self.settled.changed_by(self.reach)
    }
}

/// Follows the speeds that blocks bring.
#[derive(Clone, Copy, Debug, Default)]
pub struct GivenSpeeds {
    pass: ForwardPass,
    /// Sum of 2 a S over all blocks in the ring: the largest squared speed from which they can
    /// bring the machine to rest.
    reach: u64,
    /// Speed with which the last block left, and its square.
    last_exit: Speed,
    last_squared_exit: SquaredSpeed,
}

impl GivenSpeeds {
    /// Settles the exit speed of the oldest block, which leaves before `next`.
    #[inline(always)]
    fn settle(&mut self, reach: u64, nominal: Speed, next: &Waiting) {
        self.reach = self.reach.saturating_sub(reach);
        let (planned, root) = (next.entry, next.entry_speed);
        // Nearly always the speed is as planned. All are below 2^63.
        let gain = planned.units().wrapping_sub(self.last_squared_exit.units()).cast_signed();
        let is_reached = gain <= reach.cast_signed();
        if is_reached && planned.units() <= self.reach && root > Speed::ZERO && root <= nominal {
            (self.last_exit, self.last_squared_exit) = (root, planned);
        } else {
            self.last_exit = self.slower_exit(reach, nominal, planned);
            self.last_squared_exit = self.last_exit.into();
        }
    }

    #[inline(never)]
    fn slower_exit(&self, reach: u64, nominal: Speed, planned: SquaredSpeed) -> Speed {
        let entry = self.last_squared_exit;
        // A lowered nominal speed is reached as fast as the block can slow down to it.
        let held = SquaredSpeed::from(nominal).max(entry.slowed_by(reach));
        let most = planned.min(held).min(SquaredSpeed::from_units(self.reach));
        most.min(entry.changed_by(reach)).root()
    }
}

impl SpeedPlan for GivenSpeeds {
    #[inline(always)]
    fn push<S: RingMemory>(&mut self, ring: &mut Ring<S>, block: &Block, start: &BlockStart) -> Result<(), PlanFault> {
        let reach = block.reach();
        let bound = start.corner.min(start.nominal).min(ring.newest_nominal);
        let squared = SquaredSpeed::from(bound);
        let (entry, entry_speed) = if start.entry == EntrySpeed::Bound && !ring.stopped {
            (self.pass.enter(reach, squared)?, bound)
        } else {
            (self.pass.next_over(reach, squared, ring.stopped, start.entry)?, Speed::ZERO)
        };
        self.reach = self.reach.saturating_add(reach);
        ring.stopped = false;
        ring.newest_nominal = start.nominal;
        ring.push_with(|content| {
            // Nearly always a block was here before. Fields that a prepared block does not use may
            // stay.
            if !matches!(content, Content::Block(_)) {
                *content = Content::Block(Waiting::NONE);
            }
            if let Content::Block(waiting) = content {
                waiting.block.become_block(block);
                (waiting.entry, waiting.entry_speed) = (entry, entry_speed);
            }
        });
        Ok(())
    }

    /// Takes the oldest block or marker from the ring. The blocks after it must be able to stop the
    /// machine.
    #[inline(never)]
    fn pop<S: RingMemory>(&mut self, ring: &mut Ring<S>, pace: Pace) -> Option<Released> {
        let Some(Content::Block(waiting)) = ring.first() else { return ring.pop_marker().map(Released::Marker) };
        let nominal = waiting.block.nominal;
        let capped = if pace == Pace::FULL { nominal } else { pace.of(nominal) };
        let entry = self.last_exit;
        let next = ring.second_block();
        match next {
            Some(next) => self.settle(waiting.block.reach(), capped, next),
            None => (self.reach, self.last_exit, self.last_squared_exit) = (0, Speed::ZERO, SquaredSpeed::ZERO),
        }
        let (is_last, exit) = (next.is_none(), self.last_exit);
        let mut planned = PlannedBlock { block: waiting.block, entry, exit };
        planned.block.nominal = capped.max(entry).max(exit);
        ring.pass_block();
        ring.stopped |= is_last;
        ring.last_nominal = nominal;
        Some(Released::Block(planned))
    }

    fn clear(&mut self) {
        *self = Self::default();
    }
}
