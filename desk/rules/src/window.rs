//! Look-ahead over a short queue, as in Marlin and RepRapFirmware. Speeds are squared, (mm/s)^2.
//!
//! Each move starts no faster than its corner allows, than the later moves can brake from, and than
//! the earlier moves can reach. Motion ends after the last known move. The first move's start is
//! fixed, because the move before it is running.

use crate::motion::{Limit, Phases, PlannedMove};
use std::collections::VecDeque;

/// Move whose speeds are still being computed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    pub tag: u64,
    pub length_mm: f64,
    pub acceleration: f64,
    /// Maximum speed of the block.
    pub nominal: f64,
    /// Maximum speed at the start, by the corner.
    pub max_entry: f64,
    /// Minimum speed at the start, whatever the earlier moves can reach.
    pub min_entry: f64,
    /// Speed at the end while the block is the last of the queue.
    pub last_exit: f64,
    pub entry_limit: Limit,
    pub speed_limit: Limit,
    pub acceleration_limit: Limit,
}

impl Block {
    /// Returns the maximum gain of squared speed over the length.
    fn gain(&self) -> f64 {
        2.0 * self.acceleration * self.length_mm
    }
}

/// Queue of moves, the first of which is about to run.
#[derive(Clone, Debug, Default)]
pub(crate) struct Window {
    blocks: VecDeque<Block>,
    /// Start speed of the first move, and its limit; `None` while motion is at rest.
    entry: Option<(f64, Limit)>,
}

impl Window {
    /// Returns the number of waiting moves.
    pub fn len(&self) -> usize {
        self.blocks.len()
    }

    /// Appends a move. It starts no faster than its own nominal speed and that of the previous
    /// move.
    pub fn push(&mut self, mut block: Block) {
        let before = self.blocks.back().map_or(f64::INFINITY, |before| before.nominal);
        let most = block.nominal.min(before);
        block.max_entry = block.max_entry.min(most);
        block.min_entry = block.min_entry.min(most);
        self.blocks.push_back(block);
    }

    /// Marks the motion as at rest: the next move starts from rest.
    pub fn rest(&mut self) {
        self.entry = None;
    }

    /// Returns the entry speed of the first move, and its limit.
    fn first_entry(&self, first: &Block) -> (f64, Limit) {
        self.entry.unwrap_or((first.min_entry.min(first.nominal), Limit::Rest))
    }

    /// Returns the speed at the end of the first move, and its limit, with all waiting moves known.
    fn exit_of_first(&self) -> Option<(f64, Limit)> {
        let first = self.blocks.front()?;
        let last = self.blocks.back()?;
        let mut next = (last.last_exit.min(last.nominal), Limit::Rest);
        for block in self.blocks.range(1..).rev() {
            let braking = next.0 + block.gain();
            next = if braking < block.max_entry {
                (braking, block.acceleration_limit)
            } else {
                (block.max_entry, block.entry_limit)
            };
        }
        Some(self.reached(first, self.first_entry(first).0, next))
    }

    /// Returns the speed after a move, if the next one would start at `next`.
    fn reached(&self, block: &Block, entry: f64, next: (f64, Limit)) -> (f64, Limit) {
        let reachable = entry + block.gain();
        if reachable < next.0 {
            (
                reachable.max(next.0.min(self.blocks.get(1).map_or(0.0, |after| after.min_entry))),
                block.acceleration_limit,
            )
        } else {
            next
        }
    }

    /// Removes and returns the first move with its plan, which later moves can no longer change.
    pub fn release(&mut self) -> Option<PlannedMove> {
        let exit = self.exit_of_first()?;
        let first = self.blocks.pop_front()?;
        let (entry, start_limit) = self.first_entry(&first);
        self.entry = (!self.blocks.is_empty()).then_some(exit);
        Some(planned(&first, entry, start_limit, exit.0))
    }

    /// Passes the present plans of all moves to `each`.
    pub fn plans(&self, speeds: &mut Vec<f64>, mut each: impl FnMut(&Block, Phases)) {
        let (Some(first), Some(last)) = (self.blocks.front(), self.blocks.back()) else { return };
        // Start speeds by corner and braking, from the last move to the first.
        speeds.clear();
        let mut next = last.last_exit.min(last.nominal);
        for block in self.blocks.range(1..).rev() {
            speeds.push(next);
            next = (next + block.gain()).min(block.max_entry);
        }
        speeds.push(next);
        let mut entry = self.first_entry(first).0;
        for (block, exit) in self.blocks.iter().zip(speeds.iter().rev()) {
            let exit = exit.min(entry + block.gain());
            each(block, Phases::fastest(block.length_mm, block.acceleration, entry, block.nominal, exit).0);
            entry = exit;
        }
    }
}

fn planned(block: &Block, entry: f64, start_limit: Limit, exit: f64) -> PlannedMove {
    let (phases, is_nominal) = Phases::fastest(block.length_mm, block.acceleration, entry, block.nominal, exit);
    let is_one_ramp = phases.accelerate_s == 0.0 || phases.decelerate_s == 0.0;
    let cruise_limit = match (is_nominal, is_one_ramp) {
        (true, _) => block.speed_limit,
        (false, true) => block.acceleration_limit,
        (false, false) => Limit::ShortMove,
    };
    PlannedMove {
        tag: block.tag,
        length_mm: block.length_mm,
        start_mm_per_s: phases.start,
        cruise_mm_per_s: phases.cruise,
        end_mm_per_s: phases.end,
        acceleration_mm_per_s2: block.acceleration,
        accelerate_s: phases.accelerate_s,
        cruise_s: phases.cruise_s,
        decelerate_s: phases.decelerate_s,
        start_limit,
        cruise_limit,
        acceleration_limit: block.acceleration_limit,
    }
}
