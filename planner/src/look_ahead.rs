//! The ring of blocks whose speeds are not settled yet.

mod prepared;
mod runs;

use crate::block::{Block, PlannedBlock, Speed, SquaredSpeed};
use crate::pace::Pace;
use crate::s_curve::staircase::Pulses;
use crate::s_curve::{FrequencyTable, Jerk};
use prepared::Prepared;
use runs::Runs;

pub use prepared::{Entry, Pass, Violation};
pub use runs::Part;

/// A block in the ring with what the passes need.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    block: Block,
    /// Bound of the squared entry speed from the junction and both nominal speeds.
    entry_bound: SquaredSpeed,
    /// Squared entry speed from the reverse pass, or the settled one.
    entry: SquaredSpeed,
    /// The block before has left with this speed.
    settled: bool,
    /// Under an S-curve: bound of the entry speed, the speed from which everything from here on can be done, and how many
    /// places ahead the corner is to which one ramp from it goes. Of very slow speeds several have one square.
    run_bound: Speed,
    /// Of a prepared block: the root of its entry speed, or nothing where that has not been worked out.
    run_entry: Speed,
    anchor: u8,
}

impl Waiting {
    /// What stands where there is no block.
    const NONE: Self = Self {
        block: Block::NONE,
        entry_bound: SquaredSpeed::ZERO,
        entry: SquaredSpeed::ZERO,
        settled: false,
        run_bound: Speed::ZERO,
        run_entry: Speed::ZERO,
        anchor: 0,
    };
}

/// How speeds change along the blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpeedLaw {
    /// At a constant acceleration.
    Trapezoid,
    /// At a constant jerk, under which neighbouring blocks share one law where that is faster.
    SCurve(Jerk),
    /// At a constant jerk, and at no acceleration at the ends of every block: what the former gains is seen by this.
    SCurveBlockByBlock(Jerk),
    /// As a table of frequencies has it.
    Table(FrequencyTable),
}

/// The law, with what only its look-ahead needs.
#[derive(Clone, Copy, Debug)]
enum Law {
    Trapezoid,
    Runs(Runs),
    Table(FrequencyTable),
    /// Speeds come with the blocks.
    Prepared(Prepared),
}

/// Something that keeps its place among the blocks but takes no time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marker {
    /// The fan changes here.
    FanPower {
        /// Power, 0 to 255.
        power: u8,
    },
}

/// What leaves the ring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Left {
    /// A block with settled speeds.
    Block(PlannedBlock),
    /// A block of a run, under an S-curve.
    Part(Part),
    /// A marker.
    Marker(Marker),
}

/// A place in the ring. Callers only provide the memory.
#[derive(Clone, Copy, Debug)]
pub struct Slot(Content);

#[derive(Clone, Copy, Debug)]
enum Content {
    Empty,
    Block(Waiting),
    Marker(Marker),
}

impl Slot {
    /// An empty place.
    pub const EMPTY: Self = Self(Content::Empty);
}

/// The look-ahead ring (Yu 2019).
///
/// Its plan depends on the order of the blocks only, not on when they come: a block leaves when the ring is full, on
/// a flush, or when [`Self::release`] says that steps run out.
#[derive(Debug)]
pub struct LookAhead<S> {
    slots: S,
    first: usize,
    length: usize,
    /// Blocks and markers that may leave although the ring is not full.
    released: usize,
    /// The next block starts from standstill.
    stopped: bool,
    /// Nominal speed of the newest block, as it was planned.
    newest_nominal: Speed,
    /// Squared speed with which the last block left, for the next to start with.
    left_with: SquaredSpeed,
    /// Blocks in the ring, markers not counted.
    blocks: usize,
    /// What the last block that left had wanted for its nominal speed.
    left_nominal: Speed,
    /// Squared entry speeds of the last block that left and of the next one, as the reverse pass had them, and the bound of
    /// the former: what somebody writes down who prepares a job.
    left_entry: SquaredSpeed,
    left_bound: SquaredSpeed,
    next_entry: SquaredSpeed,
    law: Law,
}

impl<S: AsRef<[Slot]> + AsMut<[Slot]>> LookAhead<S> {
    /// A ring in the given memory; it needs at least two places to be of use.
    pub fn new(slots: S) -> Self {
        Self {
            slots,
            first: 0,
            length: 0,
            released: 0,
            stopped: true,
            newest_nominal: Speed::ZERO,
            left_with: SquaredSpeed::ZERO,
            blocks: 0,
            left_nominal: Speed::ZERO,
            left_entry: SquaredSpeed::ZERO,
            left_bound: SquaredSpeed::ZERO,
            next_entry: SquaredSpeed::ZERO,
            law: Law::Trapezoid,
        }
    }

    /// Sets how speeds change, for a ring that is empty.
    pub fn set_law(&mut self, law: &SpeedLaw) {
        self.law = match law {
            SpeedLaw::Trapezoid => Law::Trapezoid,
            SpeedLaw::SCurve(jerk) => Law::Runs(Runs::new(*jerk, true)),
            SpeedLaw::SCurveBlockByBlock(jerk) => Law::Runs(Runs::new(*jerk, false)),
            SpeedLaw::Table(table) => Law::Table(*table),
        };
        self.clear();
    }

    /// Whether another block or marker fits.
    pub fn has_room(&self) -> bool {
        self.length < self.slots.as_ref().len()
    }

    /// Whether nothing waits here.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Number of blocks and markers that wait here.
    pub fn len(&self) -> usize {
        self.length
    }

    /// The nominal speed of the last block that left, before the pace was taken off.
    pub fn left_nominal(&self) -> Speed {
        self.left_nominal
    }

    /// Whether the oldest block or marker may leave.
    pub fn can_leave(&self) -> bool {
        self.length > 0 && (self.released > 0 || !self.has_room())
    }

    /// Adds a block and lets its stopping distance raise the speeds before it; `false` without room.
    ///
    /// `junction` is the speed bound of the corner before it.
    pub fn push(&mut self, block: &Block, junction: Speed) -> bool {
        if !self.has_room() {
            return false;
        }
        let held;
        let block = if let Law::Table(table) = &self.law {
            // No faster than the table goes.
            let nominal = block.nominal.min(Pulses::of(block).speed(table.top_hz()));
            held = Block { nominal, ..*block };
            &held
        } else {
            block
        };
        let bound = if self.stopped { Speed::ZERO } else { junction.min(block.nominal).min(self.newest_nominal) };
        self.stopped = false;
        self.newest_nominal = block.nominal;
        let table = match self.law {
            Law::Trapezoid => None,
            Law::Runs(runs) => {
                self.push_to_runs(&runs, block, bound);
                return true;
            }
            Law::Table(table) => Some(table),
            // Its speeds would have to come with it.
            Law::Prepared(_) => return false,
        };
        let bound = SquaredSpeed::from(bound);
        // Where the block before has left already, it left with a speed that this one starts with.
        let settled = self.blocks == 0;
        let place = self.length;
        let entry = if settled { self.left_with } else { bound.min(reach(&table, SquaredSpeed::ZERO, block)) };
        let (run_bound, run_entry, anchor) = (Speed::ZERO, Speed::ZERO, 0);
        self.place_block(Waiting { block: *block, entry_bound: bound, entry, settled, run_bound, run_entry, anchor });
        if !settled {
            self.reverse_pass(&table, place, entry);
        }
        true
    }

    #[inline(always)]
    fn place_block(&mut self, waiting: Waiting) {
        if let Some(slot) = self.next_slot() {
            slot.0 = Content::Block(waiting);
            self.length = self.length.wrapping_add(1);
            self.blocks = self.blocks.wrapping_add(1);
        }
    }

    /// The place behind the newest, of a ring that has room.
    #[inline(always)]
    fn next_slot(&mut self) -> Option<&mut Slot> {
        let slots = self.slots.as_mut();
        let (index, capacity) = (self.first.wrapping_add(self.length), slots.len());
        slots.get_mut(if index >= capacity { index.wrapping_sub(capacity) } else { index })
    }

    /// Adds a marker; `false` without room.
    pub fn push_marker(&mut self, marker: Marker) -> bool {
        if !self.has_room() {
            return false;
        }
        *self.at(self.length) = Content::Marker(marker);
        self.length += 1;
        true
    }

    /// Yu 2019: v_s = sqrt(v_e^2 + 2 a s), from the newest block backwards until nothing changes any more: speeds
    /// only rise when a block is added, and a block that keeps its speed keeps all before it.
    fn reverse_pass(&mut self, table: &Option<FrequencyTable>, newest: usize, newest_entry: SquaredSpeed) {
        let mut exit = newest_entry;
        for place in (0..newest).rev() {
            let Content::Block(waiting) = self.at(place) else { continue };
            if waiting.settled {
                return;
            }
            let entry = waiting.entry_bound.min(reach(table, exit, &waiting.block));
            if entry == waiting.entry {
                return;
            }
            waiting.entry = entry;
            exit = entry;
        }
    }

    /// Takes the oldest block or marker if it may leave. Yu's forward pass happens here, a block at a time: the exit
    /// speed is what the next block's entry and this block's own acceleration allow.
    ///
    /// A block that leaves is held to the pace, as far as it can slow down to it on its own length.
    #[inline]
    pub fn pop(&mut self, pace: Pace) -> Option<Left> {
        if !self.can_leave() {
            return None;
        }
        if self.is_prepared() { self.pop_prepared(pace) } else { self.pop_planned(pace) }
    }

    #[inline(never)]
    fn pop_planned(&mut self, pace: Pace) -> Option<Left> {
        let table = match self.law {
            Law::Trapezoid => None,
            Law::Runs(mut runs) => {
                let left = self.pop_from_runs(&mut runs, pace);
                self.law = Law::Runs(runs);
                return left;
            }
            Law::Table(table) => Some(table),
            Law::Prepared(_) => return None,
        };
        let (mut planned, squared_entry) = match &self.slots.as_ref().get(self.first)?.0 {
            Content::Empty => {
                self.pass_first();
                return None;
            }
            &Content::Marker(marker) => {
                self.pass_first();
                return Some(Left::Marker(marker));
            }
            // A block is large: it is copied once.
            Content::Block(waiting) => {
                self.left_bound = waiting.entry_bound;
                let planned = PlannedBlock { block: waiting.block, entry: waiting.entry.root(), exit: Speed::ZERO };
                (planned, waiting.entry)
            }
        };
        self.pass_first();
        self.blocks -= 1;
        let PlannedBlock { block, entry, exit } = &mut planned;
        self.left_nominal = block.nominal;
        self.left_entry = self.next_entry;
        let mut reachable = reach(&table, squared_entry, block);
        if pace != Pace::FULL {
            let capped = pace.of(block.nominal);
            let slowed = match &table {
                None => squared_entry.slowed_over(block),
                Some(table) => Pulses::of(block).slowest(table, *entry, capped).into(),
            };
            reachable = reachable.min(SquaredSpeed::from(capped).max(slowed));
            block.nominal = capped;
        }
        *exit = self.settle_next(reachable);
        self.left_with = (*exit).into();
        block.nominal = block.nominal.max(*entry).max(*exit);
        Some(Left::Block(planned))
    }

    /// Takes the oldest place.
    fn take_first(&mut self) -> Option<Content> {
        let content = self.slots.as_ref().get(self.first)?.0;
        self.pass_first();
        Some(content)
    }

    /// The oldest place is free.
    fn pass_first(&mut self) {
        let next = self.first + 1;
        self.first = if next == self.slots.as_ref().len() { 0 } else { next };
        self.length -= 1;
        self.released = self.released.saturating_sub(1);
    }

    /// Fixes the entry speed of the oldest block that is left; zero where there is none, and then the next block
    /// that comes starts from standstill.
    fn settle_next(&mut self, reachable: SquaredSpeed) -> Speed {
        for place in 0..self.length {
            if let Content::Block(next) = self.at(place) {
                let speed = next.entry.min(reachable).root();
                let planned = core::mem::replace(&mut next.entry, speed.into());
                next.settled = true;
                self.next_entry = planned;
                return speed;
            }
        }
        self.stopped = true;
        self.next_entry = SquaredSpeed::ZERO;
        Speed::ZERO
    }

    /// Motion stops after the newest block; all that wait may leave.
    pub fn flush(&mut self) {
        self.stopped = true;
        self.released = self.length;
    }

    /// Lets one more leave although the ring is not full, because steps run out.
    pub fn release(&mut self) {
        self.released = (self.released + 1).min(self.length);
    }

    /// Forgets all that waits; the next block starts from standstill.
    pub fn clear(&mut self) {
        // Every field is named: a new one has to say here what remains of it after a stop.
        let Self {
            slots: _,
            first: _,
            length,
            released,
            stopped,
            newest_nominal,
            left_with,
            blocks,
            left_nominal,
            left_entry,
            left_bound,
            next_entry,
            law,
        } = self;
        *length = 0;
        *released = 0;
        *stopped = true;
        *newest_nominal = Speed::ZERO;
        *left_with = SquaredSpeed::ZERO;
        *blocks = 0;
        *left_nominal = Speed::ZERO;
        *left_entry = SquaredSpeed::ZERO;
        *left_bound = SquaredSpeed::ZERO;
        *next_entry = SquaredSpeed::ZERO;
        match law {
            Law::Runs(runs) => runs.clear(),
            Law::Prepared(prepared) => *prepared = Prepared::default(),
            Law::Trapezoid | Law::Table(_) => {}
        }
    }

    fn at(&mut self, place: usize) -> &mut Content {
        let slots = self.slots.as_mut();
        let capacity = slots.len();
        let index = self.first + place;
        &mut slots[if index >= capacity { index - capacity } else { index }].0
    }
}

/// The largest squared speed that can be reached from this one over a block.
#[inline]
fn reach(table: &Option<FrequencyTable>, from: SquaredSpeed, block: &Block) -> SquaredSpeed {
    match table {
        None => from.changed_over(block),
        Some(table) => Pulses::of(block).reach(table, from.root()).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::Acceleration;
    use proptest::prelude::*;

    fn block(nominal: f64, acceleration: f64, length_mm: f64) -> Block {
        Block {
            steps: [100, 0, 0],
            extruder_256ths: 0,
            length_10nm: (length_mm * 100_000.0).round() as u32,
            nominal: Speed::from_mm_per_s(nominal),
            acceleration: Acceleration::from_mm_per_s2(acceleration),
            line: 0,
            ends_move: true,
            inner_ends: Default::default(),
        }
    }

    /// Both passes over the whole list, the plain way.
    fn reference(moves: &[(f64, f64, f64, f64)]) -> Vec<f64> {
        let mut entries: Vec<f64> = vec![0.0; moves.len() + 1];
        for i in 1..moves.len() {
            entries[i] = moves[i].3.min(moves[i].0 * moves[i].0).min(moves[i - 1].0 * moves[i - 1].0);
        }
        for i in (0..moves.len()).rev() {
            entries[i] = entries[i].min(entries[i + 1] + 2.0 * moves[i].1 * moves[i].2);
        }
        entries[0] = 0.0;
        for i in 0..moves.len() {
            entries[i + 1] = entries[i + 1].min(entries[i] + 2.0 * moves[i].1 * moves[i].2);
        }
        entries.iter().map(|squared| squared.sqrt()).collect()
    }

    proptest! {
        #[test]
        fn an_ample_ring_equals_both_passes_over_everything(
            moves in proptest::collection::vec((1.0f64..300.0, 100.0f64..10_000.0, 0.01f64..20.0, 0.0f64..40_000.0), 1..60),
            markers in any::<u64>(),
        ) {
            // Whole units of 10 nm, as in a block.
            let moves: Vec<_> = moves.into_iter().map(|(v, a, length, j)| (v, a, f64::floor(length * 1e5) / 1e5, j)).collect();
            let mut ring = LookAhead::new(vec![Slot::EMPTY; 128]);
            for (i, &(nominal, acceleration, length, junction)) in moves.iter().enumerate() {
                prop_assert!(ring.push(&block(nominal, acceleration, length), Speed::from_mm_per_s(junction.sqrt())));
                if markers >> (i % 64) & 1 == 1 {
                    let pushed = ring.push_marker(Marker::FanPower { power: 7 });
                    prop_assert!(pushed);
                }
            }
            prop_assert!(!ring.can_leave());
            ring.flush();
            let expected = reference(&moves);
            let mut at = 0;
            while let Some(left) = ring.pop(Pace::FULL) {
                let Left::Block(planned) = left else { continue };
                prop_assert!((planned.entry.mm_per_s() - expected[at]).abs() < 1e-3);
                prop_assert!((planned.exit.mm_per_s() - expected[at + 1]).abs() < 1e-3);
                at += 1;
            }
            prop_assert_eq!(at, moves.len());
        }

        #[test]
        fn a_small_ring_never_breaks_an_acceleration(
            moves in proptest::collection::vec((1.0f64..300.0, 100.0f64..10_000.0, 0.01f64..20.0, 0.0f64..40_000.0), 1..200),
            capacity in 2usize..16, flushes in any::<u128>(),
        ) {
            let mut ring = LookAhead::new(vec![Slot::EMPTY; capacity]);
            let mut left = Vec::new();
            for (i, &(nominal, acceleration, length, junction)) in moves.iter().enumerate() {
                while !ring.has_room() {
                    left.extend(ring.pop(Pace::FULL));
                }
                prop_assert!(ring.push(&block(nominal, acceleration, length), Speed::from_mm_per_s(junction.sqrt())));
                if flushes >> (i % 128) & 7 == 7 {
                    ring.release();
                    left.extend(ring.pop(Pace::FULL));
                }
            }
            ring.flush();
            while let Some(one) = ring.pop(Pace::FULL) {
                left.push(one);
            }
            let mut speed = Speed::ZERO;
            for one in left {
                let Left::Block(planned) = one else { continue };
                prop_assert_eq!(planned.entry, speed);
                speed = planned.exit;
                let reach = 2.0 * planned.block.acceleration.mm_per_s2() * planned.block.length_mm();
                prop_assert!((planned.exit.squared() - planned.entry.squared()).abs() <= reach + 0.02);
                prop_assert!(planned.entry <= planned.block.nominal && planned.exit <= planned.block.nominal);
            }
            prop_assert_eq!(speed, Speed::ZERO);
        }
    }
}
