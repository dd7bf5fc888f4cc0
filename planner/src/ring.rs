//! The ring in which blocks wait for their speeds.

use crate::block::{Block, Speed, SquaredSpeed};
use crate::pressure_advance::PressureAdvance;

/// A block in the ring with what its [`crate::speed_plan::SpeedPlan`] keeps of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Waiting {
    pub block: Block,
    /// Bound of the squared entry speed, by the corner and both nominal speeds.
    pub entry_bound: SquaredSpeed,
    /// Squared entry speed: planned so far, or settled.
    pub entry: SquaredSpeed,
    /// The block before it has left with this speed.
    pub settled: bool,
    /// Bound of the entry speed under an S-curve, which has no squares: several very slow speeds
    /// have one square.
    pub bound_speed: Speed,
    /// Entry speed under an S-curve. With given speeds: the root of `entry`, or zero before it has
    /// been worked out.
    pub entry_speed: Speed,
    /// Places from here to the corner at the end of one ramp, under an S-curve.
    pub anchor: u8,
    /// Duration, ticks, once [`Ring::final_ticks`] has counted it.
    pub ticks: u32,
}

impl Waiting {
    /// Content of an unused place.
    pub const NONE: Self = Self {
        block: Block::NONE,
        entry_bound: SquaredSpeed::ZERO,
        entry: SquaredSpeed::ZERO,
        settled: false,
        bound_speed: Speed::ZERO,
        entry_speed: Speed::ZERO,
        anchor: 0,
        ticks: 0,
    };
}

/// Marker among the blocks that keeps its place and takes no time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Marker {
    /// A fan changes here.
    FanPower {
        /// Number of the fan; only the receiver of the steps knows its meaning.
        fan: u8,
        /// Power, 0 to 255.
        power: u8,
    },
    /// The extruder runs ahead by another measure from here on.
    PressureAdvance(PressureAdvance),
}

/// A place in the ring. Callers only provide the memory.
#[derive(Clone, Copy, Debug)]
pub struct Slot(pub(crate) Content);

#[derive(Clone, Copy, Debug)]
pub(crate) enum Content {
    Empty,
    Block(Waiting),
    Marker(Marker),
}

impl Slot {
    /// An empty place.
    pub const EMPTY: Self = Self(Content::Empty);
}

/// Memory of a ring: an array, a slice or a `Vec` of [`Slot`]s.
pub trait RingMemory: AsRef<[Slot]> + AsMut<[Slot]> {}

impl<S: AsRef<[Slot]> + AsMut<[Slot]>> RingMemory for S {}

/// Blocks and markers in their order. A block leaves when the ring is full, on a flush, or when
/// [`Self::release`] or [`Self::release_final`] lets it.
#[derive(Debug)]
pub struct Ring<S> {
    slots: S,
    first: usize,
    length: usize,
    /// Blocks in the ring, markers not counted.
    blocks: usize,
    /// Number of the oldest places that may leave although the ring is not full.
    released: usize,
    /// Number of the oldest places that are final: no later block can change their speeds.
    final_places: usize,
    /// Number of the final places whose time is in `timed_ticks`.
    timed_places: usize,
    timed_ticks: u64,
    /// Squared entry speed of the block that comes next, where it is known before
    /// the block has come.
    pub(crate) next_entry: Option<SquaredSpeed>,
    /// The next block starts from standstill.
    pub(crate) stopped: bool,
    /// Nominal speed of the newest block, as it was planned.
    pub(crate) newest_nominal: Speed,
    /// Nominal speed of the block that left last, before the pace was taken off.
    pub(crate) last_nominal: Speed,
}

impl<S: RingMemory> Ring<S> {
    /// An empty ring in the given memory; it needs at least two places to be of use.
    pub(crate) fn new(slots: S) -> Self {
        Self {
            slots,
            first: 0,
            length: 0,
            blocks: 0,
            released: 0,
            final_places: 0,
            timed_places: 0,
            timed_ticks: 0,
            next_entry: None,
            stopped: true,
            newest_nominal: Speed::ZERO,
            last_nominal: Speed::ZERO,
        }
    }

    /// True if another block or marker fits.
    pub(crate) fn has_room(&self) -> bool {
        self.length < self.slots.as_ref().len()
    }

    /// Number of blocks and markers in the ring.
    pub(crate) fn len(&self) -> usize {
        self.length
    }

    /// True if a block is in the ring.
    pub(crate) fn has_blocks(&self) -> bool {
        self.blocks > 0
    }

    /// True if the oldest block or marker may leave.
    pub(crate) fn can_leave(&self) -> bool {
        self.length > 0 && (self.released > 0 || !self.has_room())
    }

    /// Adds a block to a ring that has room.
    #[inline(always)]
    pub(crate) fn push(&mut self, waiting: Waiting) {
        self.push_with(|content| *content = Content::Block(waiting));
    }

    /// Adds a block to a ring that has room; `fill` writes it into its place, which still holds
    /// the former contents.
    #[inline(always)]
    pub(crate) fn push_with(&mut self, fill: impl FnOnce(&mut Content)) {
        if let Some(content) = self.at(self.length) {
            fill(content);
            self.next_entry = None;
            self.length = self.length.wrapping_add(1);
            self.blocks = self.blocks.wrapping_add(1);
        }
    }

    /// Adds a marker; `false` without room.
    pub(crate) fn push_marker(&mut self, marker: Marker) -> bool {
        let has_room = self.has_room();
        if has_room && let Some(content) = self.at(self.length) {
            *content = Content::Marker(marker);
            self.length = self.length.wrapping_add(1);
        }
        has_room
    }

    /// Content of a place, counted from the oldest; for the place after the newest in a ring that
    /// has room, its previous content.
    #[inline(always)]
    pub(crate) fn at(&mut self, place: usize) -> Option<&mut Content> {
        let slots = self.slots.as_mut();
        // Neither number is more than that of the places.
        let (index, capacity) = (self.first.wrapping_add(place), slots.len());
        slots.get_mut(if index >= capacity { index.wrapping_sub(capacity) } else { index }).map(|slot| &mut slot.0)
    }

    /// Content of a place, counted from the oldest; `None` after the newest.
    pub(crate) fn get(&self, place: usize) -> Option<&Content> {
        let slots = self.slots.as_ref();
        let (index, capacity) = (self.first.wrapping_add(place), slots.len());
        let index = if index >= capacity { index.wrapping_sub(capacity) } else { index };
        slots.get(index).filter(|_| place < self.length).map(|slot| &slot.0)
    }

    /// Content of the oldest place.
    #[inline(always)]
    pub(crate) fn first(&self) -> Option<&Content> {
        self.slots.as_ref().get(self.first).map(|slot| &slot.0)
    }

    /// The blocks, from the oldest on.
    pub(crate) fn iter_blocks(&self) -> impl Iterator<Item = &Waiting> {
        let (before, from_first) = self.slots.as_ref().split_at_checked(self.first).unwrap_or_default();
        from_first.iter().chain(before).take(self.length).filter_map(|slot| match &slot.0 {
            Content::Block(waiting) => Some(waiting),
            Content::Empty | Content::Marker(_) => None,
        })
    }

    /// The block that waits after the oldest place.
    #[inline(always)]
    pub(crate) fn second_block(&self) -> Option<&Waiting> {
        let slots = self.slots.as_ref();
        let next = self.first.wrapping_add(1);
        match slots.get(if next == slots.len() { 0 } else { next }) {
            Some(Slot(Content::Block(waiting))) if self.length > 1 => Some(waiting),
            _ => self.block_after_markers(),
        }
    }

    #[cold]
    #[inline(never)]
    fn block_after_markers(&self) -> Option<&Waiting> {
        let oldest = usize::from(matches!(self.first(), Some(Content::Block(_))));
        self.iter_blocks().nth(oldest)
    }

    /// Frees the oldest place, which holds a block.
    #[inline(always)]
    pub(crate) fn pass_block(&mut self) {
        self.blocks = self.blocks.wrapping_sub(1);
        if self.timed_places > 0
            && let Some(Content::Block(waiting)) = self.first()
        {
            self.timed_ticks = self.timed_ticks.saturating_sub(u64::from(waiting.ticks));
        }
        self.pass_first();
    }

    /// Takes the marker in the oldest place, which is freed.
    #[inline(never)]
    pub(crate) fn pop_marker(&mut self) -> Option<Marker> {
        let marker = match self.first() {
            Some(Content::Marker(marker)) => Some(*marker),
            _ => None,
        };
        self.pass_first();
        marker
    }

    #[inline(always)]
    fn pass_first(&mut self) {
        let next = self.first.wrapping_add(1);
        self.first = if next == self.slots.as_ref().len() { 0 } else { next };
        self.length = self.length.saturating_sub(1);
        self.released = self.released.saturating_sub(1);
        self.final_places = self.final_places.saturating_sub(1);
        self.timed_places = self.timed_places.saturating_sub(1);
    }

    /// Marks the speeds of all blocks before this place as final, as its block begins as
    /// fast as it ever may.
    #[inline(always)]
    pub(crate) fn set_final_before(&mut self, place: usize) {
        self.final_places = self.final_places.max(place);
    }

    /// True if the oldest place is final.
    pub(crate) fn is_first_final(&self) -> bool {
        self.final_places > 0
    }

    /// Duration of the blocks in the final places, ticks. Each block's time is computed once.
    pub(crate) fn final_ticks(&mut self, ticks_of: impl Fn(&Waiting, SquaredSpeed) -> u64) -> u64 {
        while self.timed_places < self.final_places {
            let place = self.timed_places;
            let exit = (place + 1..self.length).find_map(|next| match self.get(next) {
                Some(Content::Block(next)) => Some(next.entry),
                _ => None,
            });
            let exit = exit.or(self.next_entry);
            if let Some(Content::Block(waiting)) = self.at(place) {
                waiting.ticks = u32::try_from(ticks_of(waiting, exit.unwrap_or_default())).unwrap_or(u32::MAX);
                let ticks = u64::from(waiting.ticks);
                self.timed_ticks = self.timed_ticks.saturating_add(ticks);
            }
            self.timed_places += 1;
        }
        self.timed_ticks
    }

    /// The first block that is not final: a later one may still change the speed at its end.
    pub(crate) fn first_not_final(&self) -> Option<&Waiting> {
        (self.final_places..self.length).find_map(|place| match self.get(place) {
            Some(Content::Block(waiting)) => Some(waiting),
            _ => None,
        })
    }

    /// Releases the final places although the ring is not full.
    pub(crate) fn release_final(&mut self) {
        self.released = self.released.max(self.final_places);
    }

    /// Stops motion after the newest block; all blocks and markers may leave.
    pub(crate) fn flush(&mut self) {
        self.stopped = true;
        self.released = self.length;
    }

    /// Releases one more block although the ring is not full, because steps run out.
    pub(crate) fn release(&mut self) {
        self.released = (self.released + 1).min(self.length);
    }

    /// Forgets all that waits; the next block starts from standstill.
    pub(crate) fn clear(&mut self) {
        // Every field is named: a new one has to say here what remains of it after a stop.
        let Self {
            slots: _,
            first: _,
            length,
            blocks,
            released,
            final_places,
            timed_places,
            timed_ticks,
            next_entry,
            stopped,
            newest_nominal,
            last_nominal,
        } = self;
        *length = 0;
        *blocks = 0;
        *released = 0;
        *final_places = 0;
        *timed_places = 0;
        *timed_ticks = 0;
        *next_entry = None;
        *stopped = true;
        *newest_nominal = Speed::ZERO;
        *last_nominal = Speed::ZERO;
    }
}
