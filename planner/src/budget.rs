//! Speeds that the processor can keep up with.

use crate::block::{Block, Speed};
use crate::inner_ends::{MAX_EXTRUDER_256THS, MAX_INNER_ENDS, MAX_LENGTH_10NM};
use crate::kinematics::{Geometry, UNITS_PER_MM};
use crate::shaping::MOST_IN_FILTER;
use crate::time_units::TICKS_PER_SECOND;

/// Cost of moves and step events, in ticks of the time granted to motion.
///
/// Every move has its cost, even if several became one block: a line is read and planned before it
/// is known to continue the previous one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Budget {
    event_ticks: f32,
    move_ticks: f32,
    /// Ticks that a piece of the plan takes from the time that filters cover; 0 without filters.
    piece_ticks: f32,
    /// Pieces of a block besides those of its moves: its ramps.
    ramp_pieces: u32,
    /// Pieces of each of its moves.
    move_pieces: u32,
    /// Maximum event cost of the moves that may still join a block.
    growth_ticks: f32,
}

impl Budget {
    /// Budget of a machine.
    pub fn new(geometry: &Geometry) -> Self {
        let (event_ticks, move_ticks) = (geometry.event_cost_ticks as f32, geometry.move_cost_ticks as f32);
        let [x, y, z, _] = geometry.steps_per_mm;
        // If two motors move an axis, each makes up to sqrt(2) times the steps of the path.
        let most_steps =
            (x.to_f64() + y.to_f64() + z.to_f64()) as f32 * (2.0 * MAX_LENGTH_10NM as f32 / UNITS_PER_MM as f32);
        // Each move in a shared block adds up to its maximum of extruder steps, one begun, and one
        // because events are rounded up.
        let events = most_steps + MAX_INNER_ENDS as f32 * (MAX_EXTRUDER_256THS as f32 / 256.0 + 2.0);
        Self {
            event_ticks,
            move_ticks,
            growth_ticks: events * event_ticks,
            piece_ticks: 0.0,
            ramp_pieces: 0,
            move_pieces: 1,
        }
    }

    /// Limits speeds so that filters of this length, ticks, cover no more pieces of the plan than
    /// their ring holds. `has_knee`: where the filament passes a speed, the extruder's advance has
    /// another slope, and the plan another piece.
    pub fn hold_pieces(&mut self, length_ticks: u32, is_s_curve: bool, has_knee: bool) {
        // A block under an S-curve may have all ramps of a run. A knee may be passed once in each
        // move, and twice in the one with the highest speed.
        self.ramp_pieces = if is_s_curve { 6 } else { 2 } + u32::from(has_knee);
        self.move_pieces = 1 + u32::from(has_knee);
        self.piece_ticks = length_ticks as f32 / MOST_IN_FILTER as f32;
    }

    /// Cost of a block of `moves` moves and `events` step events.
    ///
    /// Each step of the extruder counts as an event, though some join others.
    #[inline(always)]
    pub fn cost(&self, block: &Block, events: f32, moves: u32) -> Cost {
        // Units of 10 nm in a tick at one unit of speed.
        const PER_10NM: f32 = (65_536 * (TICKS_PER_SECOND as i64 / UNITS_PER_MM)) as f32;
        let ticks = events * self.event_ticks + moves as f32 * self.move_ticks;
        let for_pieces =
            moves.saturating_mul(self.move_pieces).saturating_add(self.ramp_pieces) as f32 * self.piece_ticks;
        let ticks = if for_pieces > ticks { for_pieces } else { ticks };
        Cost { ticks, distance: block.length_10nm as f32 * PER_10NM }
    }

    /// True if a block that may still grow can keep this speed however it grows.
    pub fn always_allows(&self, speed: Speed, block: &Block, events: f32) -> bool {
        let mut cost = self.cost(block, events, MAX_INNER_ENDS as u32 + 1);
        cost.ticks += self.growth_ticks;
        cost.slower_nominal(speed).is_none()
    }
}

/// Cost of a block, and its length.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cost {
    ticks: f32,
    /// Units of [`Speed`] times ticks.
    distance: f32,
}

impl Cost {
    /// The speed at which the block takes as long as it costs, S / (events * c_event + moves *
    /// c_move), if its nominal speed is higher.
    #[inline(always)]
    pub fn slower_nominal(&self, nominal: Speed) -> Option<Speed> {
        if nominal.0 as f32 * self.ticks <= self.distance {
            return None;
        }
        let slower = Speed((self.distance / self.ticks) as u32).max(Speed(1));
        (slower < nominal).then_some(slower)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::Acceleration;
    use crate::inner_ends::InnerEnds;
    use proptest::prelude::*;

    fn block(length_10nm: u32, steps: i32, mm_per_s: f64) -> Block {
        Block {
            steps: [steps, steps / 2, 0],
            extruder_256ths: 0,
            length_10nm,
            nominal: Speed::from_mm_per_s(mm_per_s),
            acceleration: Acceleration::from_mm_per_s2(1000.0),
            line: 1,
            ends_move: true,
            inner_ends: InnerEnds::NONE,
        }
    }

    proptest! {
        #[test]
        fn no_block_is_shorter_than_it_costs(
            length in 1u32..100_000_000, steps in -100_000i32..100_000, extruder in 0.0f32..40_000.0,
            mm_per_s in 0.1f64..500.0, moves in 1u32..9,
        ) {
            // 400,000 events and 8,000 moves a second.
            let budget =
                Budget { event_ticks: 210.0, move_ticks: 10_500.0, piece_ticks: 0.0, ramp_pieces: 0, move_pieces: 1, growth_ticks: 0.0 };
            let block = block(length, steps, mm_per_s);
            let events = block.master_steps() as f32 + extruder;
            let slower = budget.cost(&block, events, moves).slower_nominal(block.nominal);
            let cost_s = f64::from(events) / 400_000.0 + f64::from(moves) / 8_000.0;
            let seconds = |nominal: Speed| block.length_mm() / nominal.mm_per_s();
            match slower {
                None => prop_assert!(seconds(block.nominal) >= cost_s * (1.0 - 1e-6)),
                Some(slower) if slower > Speed(1) => {
                    prop_assert!(slower < block.nominal);
                    prop_assert!(seconds(slower) >= cost_s * (1.0 - 1e-6));
                    // No slower than necessary: the next higher speed would be too fast.
                    prop_assert!(seconds(Speed(slower.0 + 1 + slower.0 / 5_000_000)) <= cost_s * (1.0 + 1e-6));
                }
                Some(_) => prop_assert!(seconds(Speed(2)) <= cost_s),
            }
        }
    }

    #[test]
    fn without_costs_nothing_is_slowed() {
        let budget = Budget {
            event_ticks: 0.0,
            move_ticks: 0.0,
            piece_ticks: 0.0,
            ramp_pieces: 0,
            move_pieces: 1,
            growth_ticks: 0.0,
        };
        let block = block(1, 1_000, 500.0);
        assert_eq!(budget.cost(&block, 1_000.0, 1).slower_nominal(block.nominal), None);
    }
}
