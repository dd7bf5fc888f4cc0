//! Look-ahead (Yu 2019): finds the speeds at the ends of the blocks that wait in the ring.

mod jerk_spans;
#[cfg(test)]
mod tests;

use crate::block::{Block, PlannedBlock, Speed, SquaredSpeed};
use crate::methods::{Never, SpeedRule};
use crate::pace::Pace;
use crate::ring::{Content, Ring, Waiting};
use crate::s_curve::Jerks;
use crate::speed_plan::SpeedPlan;
use jerk_spans::Runs;

pub use crate::given_speeds::ForwardPass;
pub use crate::ring::{Marker, RingMemory, Slot};
pub use crate::speed_plan::{BlockStart, EntrySpeed, Part, PlanFault, Released};

/// Law by which speeds change along the blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpeedLaw<R = Never> {
    /// Constant acceleration.
    Trapezoid,
    /// Constant jerk; neighbouring blocks share one law if that is faster.
    SCurve(Jerks),
    /// Constant jerk, with zero acceleration at the ends of every block: the baseline for the
    /// gain of shared laws.
    SCurveBlockByBlock(Jerks),
    /// Another rule.
    Other(R),
}

/// The law, with data that only look-ahead needs.
#[derive(Clone, Copy, Debug)]
enum Law<R> {
    Trapezoid,
    Runs(Runs),
    Other(R),
}

/// Plans the speeds of blocks: a reverse pass when a block arrives, the forward pass as each
/// leaves.
#[derive(Clone, Copy, Debug)]
pub struct LookAhead<R> {
    law: Law<R>,
    /// Squared speed with which the last block left, and the next starts.
    last_exit: SquaredSpeed,
}

impl<R: SpeedRule> LookAhead<R> {
    /// Look-ahead under this law.
    pub fn new(law: &SpeedLaw<R>) -> Self {
        let law = match law {
            SpeedLaw::Trapezoid => Law::Trapezoid,
            SpeedLaw::SCurve(jerks) => Law::Runs(Runs::new(*jerks, true)),
            SpeedLaw::SCurveBlockByBlock(jerks) => Law::Runs(Runs::new(*jerks, false)),
            SpeedLaw::Other(rule) => Law::Other(*rule),
        };
        Self { law, last_exit: SquaredSpeed::ZERO }
    }

    /// Notes the next block: it will begin at the bound of its corner, and is so far `block`, which
    /// may still grow. If it is long enough to brake from there, the speeds of all earlier blocks
    /// are final, and its arrival changes none of them.
    #[inline(never)]
    pub(crate) fn foresee<S: RingMemory>(&self, ring: &mut Ring<S>, block: &Block, corner: Speed) {
        // The oldest block leaves a full ring before the next one arrives, with a speed that
        // ignores the next.
        if !matches!(self.law, Law::Trapezoid) || ring.next_entry.is_some() || !ring.has_room() {
            return;
        }
        let bound = if ring.stopped { Speed::ZERO } else { corner.min(ring.newest_nominal) };
        let entry = SquaredSpeed::from(bound);
        if entry <= SquaredSpeed::ZERO.changed_over(block) {
            let place = ring.len();
            ring.next_entry = Some(entry);
            ring.set_final_before(place);
            reverse_pass(ring, self.rule(), place, entry);
        }
    }

    fn rule(&self) -> Option<&R> {
        match &self.law {
            Law::Other(rule) => Some(rule),
            Law::Trapezoid | Law::Runs(_) => None,
        }
    }
}

impl<R: SpeedRule> SpeedPlan for LookAhead<R> {
    /// Adds a block; its stopping distance may raise the speeds before it.
    fn push<S: RingMemory>(&mut self, ring: &mut Ring<S>, block: &Block, start: &BlockStart) -> Result<(), PlanFault> {
        let held;
        let block = if let Some(rule) = self.rule() {
            held = Block { nominal: rule.nominal(block), ..*block };
            &held
        } else {
            block
        };
        let bound = if ring.stopped { Speed::ZERO } else { start.corner.min(block.nominal).min(ring.newest_nominal) };
        ring.stopped = false;
        ring.newest_nominal = block.nominal;
        if let Law::Runs(runs) = &self.law {
            runs.push(ring, block, bound);
            return Ok(());
        }
        let entry_bound = SquaredSpeed::from(bound);
        // The previous block has already left, with the speed with which this one starts.
        let settled = !ring.has_blocks();
        let place = ring.len();
        let reachable = reach(self.rule(), SquaredSpeed::ZERO, block);
        let entry = if settled { self.last_exit } else { entry_bound.min(reachable) };
        ring.push(Waiting { block: *block, entry_bound, entry, settled, ..Waiting::NONE });
        if entry == entry_bound {
            ring.set_final_before(place);
        }
        if !settled {
            reverse_pass(ring, self.rule(), place, entry);
        }
        Ok(())
    }

    /// Yu's forward pass, one block at a time: the exit speed is limited by the next block's entry
    /// and this block's acceleration.
    #[inline(never)]
    fn pop<S: RingMemory>(&mut self, ring: &mut Ring<S>, pace: Pace) -> Option<Released> {
        if let Law::Runs(runs) = &mut self.law {
            return runs.pop(ring, pace);
        }
        let (mut planned, squared_entry) = match ring.first()? {
            // A block is large: it is copied once.
            Content::Block(waiting) => {
                let planned = PlannedBlock { block: waiting.block, entry: waiting.entry.root(), exit: Speed::ZERO };
                (planned, waiting.entry)
            }
            Content::Marker(_) | Content::Empty => return ring.pop_marker().map(Released::Marker),
        };
        ring.pass_block();
        let PlannedBlock { block, entry, exit } = &mut planned;
        ring.last_nominal = block.nominal;
        let mut reachable = reach(self.rule(), squared_entry, block);
        if pace != Pace::FULL {
            let capped = pace.of(block.nominal);
            let slowed = match self.rule() {
                None => squared_entry.slowed_over(block),
                Some(rule) => rule.slowest(block, *entry, capped).into(),
            };
            reachable = reachable.min(SquaredSpeed::from(capped).max(slowed));
            block.nominal = capped;
        }
        *exit = settle_next(ring, reachable);
        self.last_exit = (*exit).into();
        block.nominal = block.nominal.max(*entry).max(*exit);
        Some(Released::Block(planned))
    }

    fn clear(&mut self) {
        self.last_exit = SquaredSpeed::ZERO;
        if let Law::Runs(runs) = &mut self.law {
            runs.clear();
        }
    }
}

/// Yu 2019: v_s = sqrt(v_e^2 + 2 a s), from the newest block backwards until nothing changes:
/// speeds only rise when a block is added, and a block with an unchanged speed leaves all earlier
/// ones unchanged.
fn reverse_pass<S: RingMemory, R: SpeedRule>(
    ring: &mut Ring<S>,
    rule: Option<&R>,
    newest: usize,
    newest_entry: SquaredSpeed,
) {
    let mut exit = newest_entry;
    for place in (0..newest).rev() {
        let Some(Content::Block(waiting)) = ring.at(place) else { continue };
        if waiting.settled {
            return;
        }
        let entry = waiting.entry_bound.min(reach(rule, exit, &waiting.block));
        if entry == waiting.entry {
            return;
        }
        waiting.entry = entry;
        exit = entry;
        if entry == waiting.entry_bound {
            ring.set_final_before(place);
        }
    }
}

/// Settles the entry speed of the oldest block in the ring, or of the next one, if that is
/// foreseen. Zero without such a block: the next one then starts from standstill.
fn settle_next<S: RingMemory>(ring: &mut Ring<S>, reachable: SquaredSpeed) -> Speed {
    for place in 0..ring.len() {
        if let Some(Content::Block(next)) = ring.at(place) {
            let speed = next.entry.min(reachable).root();
            next.entry = speed.into();
            next.settled = true;
            return speed;
        }
    }
    if let Some(entry) = ring.next_entry {
        return entry.min(reachable).root();
    }
    ring.stopped = true;
    Speed::ZERO
}

/// Largest squared speed that can be reached from this one over a block.
#[inline]
fn reach<R: SpeedRule>(rule: Option<&R>, from: SquaredSpeed, block: &Block) -> SquaredSpeed {
    match rule {
        None => from.changed_over(block),
        Some(rule) => rule.reach(block, from.root()).into(),
    }
}
