//! Record of past motion in the ring: the slots played last, those that a stop or a reset left
//! unplayed, and the words beside the ring that make it readable.
//!
//! A played slot keeps its words and the number of its last event until it is filled again. So a
//! ring in memory that program start leaves alone still holds the last motion after a reset,
//! without an additional store in the step interrupt.

use super::shared_word::WordU32;
use super::slot::Head;

/// Marker of memory that a program has set up as a ring. At power-on the word is random.
const MARKER: u32 = 0x7bb0_c5a1;

/// A slot in terms of motors (bit i = motor i).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PastSlot {
    /// Motors that step at the first event; with pulses, those whose pulse ends there.
    pub first: u8,
    /// Motors that step at the other events; with pulses, at every second one, including the last.
    pub then: u8,
    /// Motors whose direction changes at the first event.
    pub turned: u8,
    /// Those of the turned motors that run backwards from then on.
    pub backwards: u8,
    /// Reload value of the timer for the gaps after the events; with pulses, for the gaps after a
    /// pulse.
    pub reload: u32,
    /// Number of events, 1 to [`MAX_EVENTS`](super::MAX_EVENTS).
    pub events: u16,
}

/// Position of the motors at a place in the queue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PositionMark {
    /// Number of slots filled at that time, modulo 2^32. The motors reach the position once these
    /// slots and the event held back at that time have been played.
    pub filled: u32,
    /// Number of the next slot to be begun at that time.
    pub next: u32,
    /// Time since the start, ms.
    pub now_ms: u32,
    /// Steps of the motors from their origin.
    pub motor_steps: [i32; 4],
}

/// Readable contents of a ring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Past {
    /// Number of the oldest slot, modulo 2^32.
    pub oldest: u32,
    /// Number of the slot that would have been begun next.
    pub next: u32,
    /// Number of the slot after the newest one: those from `next` on were not played.
    pub filled: u32,
    /// Number of events that the slot before `next` has left unplayed.
    pub events_left: u16,
    /// Directions after the newest slot; bit i = motor i runs backwards.
    pub directions: u8,
    /// True if a stop or a reset left the record, and no motor has moved since.
    pub is_kept: bool,
    /// The two newest position marks, the newer one first.
    pub positions: [Option<PositionMark>; 2],
}

/// Words stored beside the ring.
#[derive(Debug)]
pub(super) struct Marks {
    marker: WordU32,
    motions: WordU32,
    oldest: WordU32,
    directions: WordU32,
    /// 1 from a stop or a reset until the next motion; meanwhile the four words stay as it left
    /// them.
    kept: WordU32,
    next: WordU32,
    left: WordU32,
    filled: WordU32,
    kept_directions: WordU32,
    positions: [Position; 2],
    /// Index of the position that is written next, the older one.
    older: WordU32,
}

/// A [`PositionMark`] and its check word.
#[derive(Debug)]
struct Position {
    words: [WordU32; 7],
    check: WordU32,
}

impl Position {
    const fn new() -> Self {
        Self { words: [const { WordU32::new(0) }; 7], check: WordU32::new(0) }
    }

    fn store(&self, mark: PositionMark) {
        let PositionMark { filled, next, now_ms, motor_steps: [x, y, z, extruder] } = mark;
        let values = [filled, next, now_ms, x as u32, y as u32, z as u32, extruder as u32];
        // A reset may come in between: the check word is wrong then.
        self.check.store(!sum(values));
        super::shared_word::publish();
        for (word, value) in self.words.iter().zip(values) {
            word.store(value);
        }
        super::shared_word::publish();
        self.check.store(sum(values));
    }

    fn forget(&self) {
        self.check.store(0);
        self.words.iter().for_each(|word| word.store(0));
    }

    fn load(&self) -> Option<PositionMark> {
        let values = self.words.each_ref().map(WordU32::load);
        let [filled, next, now_ms, x, y, z, extruder] = values;
        let motor_steps = [x, y, z, extruder].map(|steps| steps as i32);
        (self.check.load() == sum(values)).then_some(PositionMark { filled, next, now_ms, motor_steps })
    }
}

/// Returns the check word of these values; it is not 0 for zeros.
fn sum(values: [u32; 7]) -> u32 {
    values.into_iter().fold(MARKER, |sum, value| sum.rotate_left(5) ^ value)
}

impl Marks {
    pub(super) const fn new() -> Self {
        Self {
            marker: WordU32::new(0),
            motions: WordU32::new(0),
            oldest: WordU32::new(0),
            directions: WordU32::new(0),
            kept: WordU32::new(0),
            next: WordU32::new(0),
            left: WordU32::new(0),
            filled: WordU32::new(0),
            kept_directions: WordU32::new(0),
            positions: [const { Position::new() }; 2],
            older: WordU32::new(0),
        }
    }

    /// Sets the words to those of an empty ring.
    pub(super) fn reset(&self) {
        for word in [&self.motions, &self.oldest, &self.directions, &self.kept, &self.older] {
            word.store(0);
        }
        self.positions.iter().for_each(Position::forget);
        self.marker.store(MARKER);
    }

    pub(super) fn are_valid(&self) -> bool {
        self.marker.load() == MARKER
    }

    pub(super) fn are_kept(&self) -> bool {
        self.kept.load() == 1
    }

    pub(super) fn motions(&self) -> u32 {
        self.motions.load()
    }

    pub(super) fn note_directions(&self, directions: u8) {
        self.directions.store(directions.into());
    }

    pub(super) fn keep(&self, next: u32, left: Head, filled: u32) {
        self.next.store(next);
        self.left.store(left.events());
        self.filled.store(filled);
        self.kept_directions.store(self.directions.load());
        self.kept.store(1);
    }

    /// Forgets everything before this slot.
    pub(super) fn forget(&self, next: u32) {
        self.oldest.store(next);
        self.kept.store(0);
        // Positions from before a stop may include steps that it dropped.
        self.positions.iter().for_each(Position::forget);
    }

    pub(super) fn motion_begins(&self, next: u32) {
        if self.are_kept() {
            self.forget(next);
        }
        self.motions.store(self.motions.load().wrapping_add(1));
    }

    pub(super) fn note_position(&self, mark: PositionMark) {
        if self.are_kept() {
            return;
        }
        // If no slot was filled since, the other mark stays: at the very end of the queue an event
        // may be held back that is not in any slot.
        let older = self.older.load() & 1;
        let is_same = |place: u32| {
            let newest = self.positions.get(place as usize).and_then(Position::load);
            newest.is_some_and(|newest| newest.filled == mark.filled)
        };
        let place = if is_same(older ^ 1) { older ^ 1 } else { older };
        if let Some(position) = self.positions.get(place as usize) {
            position.store(mark);
        }
        self.older.store(place ^ 1);
    }

    pub(super) fn past(&self, next: u32, slots: usize) -> Past {
        let is_kept = self.are_kept();
        // Slots filled since then and never played have overwritten the oldest.
        let end = next;
        let (next, left, filled, directions) = if is_kept {
            (self.next.load(), self.left.load(), self.filled.load(), self.kept_directions.load())
        } else {
            (next, 0, next, self.directions.load())
        };
        // The slot before the oldest holds the number from which the oldest slot's events are
        // counted.
        let most = slots as u32 - 1;
        let oldest = self.oldest.load();
        let oldest = if end.wrapping_sub(oldest) > most { end.wrapping_sub(most) } else { oldest };
        // Words that did not survive a reset are ignored.
        let oldest = if filled.wrapping_sub(oldest) > most { filled } else { oldest };
        let [first, second] = self.positions.each_ref().map(Position::load);
        let positions = if self.older.load() & 1 == 0 { [second, first] } else { [first, second] };
        let directions = directions as u8 & 0b1111;
        Past { oldest, next, filled, events_left: left as u16, directions, is_kept, positions }
    }
}
