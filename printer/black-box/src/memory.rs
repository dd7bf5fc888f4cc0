//! Ring of records, in 4 KiB that a program start leaves uninitialised.
//!
//! All accesses are loads and stores of relaxed atomics, which on a Cortex-M are plain ones; one
//! task writes at a time. A reset may come between any two stores: the ring's ends are stored
//! twice, each with its complement, and after the bytes that they enclose.

use core::sync::atomic::{AtomicU8, AtomicU32, Ordering, compiler_fence};

use crate::record::{MAX_BYTES, OVERHEAD, Record};

/// Marker of memory that a program has set up.
const MARKER: u32 = 0x1f05_7bb1;

/// Bytes for records.
const RING: usize = 4096 - 8 * 4;

/// The memory of the records: 4 KiB, all of the backup SRAM of an STM32F4.
#[derive(Debug)]
#[repr(C)]
pub struct RecordMemory {
    marker: AtomicU32,
    /// First and last half: end and beginning of the records; and its complement.
    ends: [[AtomicU32; 2]; 2],
    /// 1: a halt or a reset has ended the recording until the next motion.
    frozen: AtomicU32,
    /// Motions that had begun at that time.
    motions: AtomicU32,
    /// Time of the newest record, ms.
    newest_ms: AtomicU32,
    ring: [AtomicU8; RING],
}

/// State of the memory at program start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Records of the previous program.
    Records,
    /// No records, as after power-on.
    Nothing,
    /// Memory that does not keep its contents: the chip has none, or it is switched off.
    NoMemory,
}

/// Beginning and end of the records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Ends {
    begin: usize,
    end: usize,
}

impl Default for RecordMemory {
    fn default() -> Self {
        Self::new()
    }
}

impl RecordMemory {
    /// Memory that is not set up yet.
    pub const fn new() -> Self {
        Self {
            marker: AtomicU32::new(0),
            ends: [const { [const { AtomicU32::new(0) }; 2] }; 2],
            frozen: AtomicU32::new(0),
            motions: AtomicU32::new(0),
            newest_ms: AtomicU32::new(0),
            ring: [const { AtomicU8::new(0) }; RING],
        }
    }

    /// Must be called once at the start, before everything else. `motions` is the number of motions
    /// that the step queue has begun: if the memory holds records of the previous program,
    /// recording resumes only after more have begun.
    pub fn restart(&self, motions: u32) -> Found {
        if self.marker.load(Ordering::Relaxed) == MARKER && self.is_consistent() {
            self.freeze(motions);
            return Found::Records;
        }
        self.clear();
        self.marker.store(MARKER, Ordering::Relaxed);
        let is_there = self.marker.load(Ordering::Relaxed) == MARKER && self.load().is_some();
        if is_there { Found::Nothing } else { Found::NoMemory }
    }

    /// True if the memory exists and is set up.
    pub fn is_there(&self) -> bool {
        self.marker.load(Ordering::Relaxed) == MARKER
    }

    /// Deletes all records and resumes recording.
    pub fn clear(&self) {
        self.frozen.store(0, Ordering::Relaxed);
        self.newest_ms.store(0, Ordering::Relaxed);
        self.store(Ends { begin: 0, end: 0 });
    }

    /// Stops recording until more than these motions have begun.
    pub fn freeze(&self, motions: u32) {
        self.motions.store(motions, Ordering::Relaxed);
        self.frozen.store(1, Ordering::Relaxed);
    }

    /// Adds a record, unless a halt or a reset has stopped the recording and nothing has moved
    /// since; the next motion restarts it. The oldest records make room.
    pub fn record(&self, now_ms: u32, motions: u32, record: &Record<'_>) {
        if self.frozen.load(Ordering::Relaxed) != 0 {
            if motions == self.motions.load(Ordering::Relaxed) {
                return;
            }
            self.clear();
        }
        self.add(now_ms, record);
    }

    /// Adds a record about the past even though recording has stopped, such as the reason for the
    /// stop. Its time is `now_ms` or, without one, the newest known time.
    pub fn add_last(&self, now_ms: Option<u32>, record: &Record<'_>) {
        self.add(now_ms.unwrap_or_else(|| self.newest_ms.load(Ordering::Relaxed)), record);
    }

    fn add(&self, now_ms: u32, record: &Record<'_>) {
        if !self.is_there() {
            return;
        }
        // Memory whose ends are damaged starts over.
        let Ends { mut begin, end } = self.load().unwrap_or(Ends { begin: 0, end: 0 });
        let parts = record.parts(now_ms);
        let bytes = parts.bytes();
        let used = |begin: usize| (end + RING - begin) % RING;
        // One byte stays free: a full ring would be an empty one.
        while begin != end && used(begin) + bytes >= RING {
            begin = self.after(begin);
        }
        self.store(Ends { begin, end });
        let mut place = end;
        parts.put(|byte| {
            if let Some(at) = self.ring.get(place) {
                at.store(byte, Ordering::Relaxed);
            }
            place = (place + 1) % RING;
        });
        self.newest_ms.store(now_ms, Ordering::Relaxed);
        self.store(Ends { begin, end: place });
    }

    /// The place after the record at this one.
    fn after(&self, place: usize) -> usize {
        (place + usize::from(self.byte(place)) + OVERHEAD) % RING
    }

    fn byte(&self, place: usize) -> u8 {
        self.ring.get(place % RING).map_or(0, |byte| byte.load(Ordering::Relaxed))
    }

    /// Bytes of the records.
    pub fn len(&self) -> usize {
        self.load().map_or(0, |Ends { begin, end }| (end + RING - begin) % RING)
    }

    /// True if there are no records.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A byte of the records, from the oldest on.
    pub fn get(&self, index: usize) -> u8 {
        self.load().map_or(0, |Ends { begin, .. }| self.byte(begin + index))
    }

    fn store(&self, Ends { begin, end }: Ends) {
        let word = end as u32 | (begin as u32) << 16;
        for [ends, complement] in &self.ends {
            // The bytes of the ring come before its ends, and one copy before the other.
            compiler_fence(Ordering::Release);
            ends.store(word, Ordering::Relaxed);
            compiler_fence(Ordering::Release);
            complement.store(!word, Ordering::Relaxed);
        }
    }

    fn load(&self) -> Option<Ends> {
        self.ends.iter().find_map(|[ends, complement]| {
            let word = ends.load(Ordering::Relaxed);
            let (begin, end) = ((word >> 16) as usize, (word & 0xffff) as usize);
            let is_sound = complement.load(Ordering::Relaxed) == !word && begin < RING && end < RING;
            is_sound.then_some(Ends { begin, end })
        })
    }

    /// True if a chain of records leads from one end to the other.
    fn is_consistent(&self) -> bool {
        let Some(Ends { begin, end }) = self.load() else { return false };
        let mut left = (end + RING - begin) % RING;
        let mut place = begin;
        while left > 0 {
            let bytes = usize::from(self.byte(place)) + OVERHEAD;
            if bytes > MAX_BYTES || bytes > left {
                return false;
            }
            left -= bytes;
            place = (place + bytes) % RING;
        }
        true
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::record::{RecordReader, Stamped};

    fn bytes(memory: &RecordMemory) -> Vec<u8> {
        (0..memory.len()).map(|index| memory.get(index)).collect()
    }

    #[test]
    fn the_memory_is_as_large_as_the_backup_sram() {
        assert_eq!(size_of::<RecordMemory>(), 4096);
    }

    #[test]
    fn a_reset_ends_the_recording_until_the_next_motion() {
        let memory = RecordMemory::new();
        assert!(!memory.is_there());
        assert_eq!(memory.restart(0), Found::Nothing);
        memory.record(5, 0, &Record::Command { line: 1, text: b"G28" });
        assert_eq!(memory.restart(7), Found::Records);
        memory.add_last(None, &Record::Reset(b"pin"));
        let before = bytes(&memory);
        let records: Vec<_> = RecordReader(&before).collect::<Option<_>>().unwrap();
        let command = Stamped { now_ms: 5, record: Record::Command { line: 1, text: b"G28" } };
        assert_eq!(records, [command, Stamped { now_ms: 5, record: Record::Reset(b"pin") }]);
        memory.record(1, 7, &Record::Halt(b"no"));
        assert_eq!(bytes(&memory), before);
        memory.record(1, 8, &Record::Halt(b"M112"));
        let after = bytes(&memory);
        let records: Vec<_> = RecordReader(&after).collect::<Option<_>>().unwrap();
        assert_eq!(records, [Stamped { now_ms: 1, record: Record::Halt(b"M112") }]);
    }

    fn any_text() -> impl Strategy<Value = Vec<u8>> {
        prop::collection::vec(any::<u8>(), 0..200)
    }

    proptest! {
        /// The newest records are kept whole and in order, as many as fit.
        #[test]
        fn the_newest_records_are_kept(texts in prop::collection::vec(any_text(), 1..150)) {
            let memory = RecordMemory::new();
            memory.restart(0);
            for (now_ms, text) in (0..).zip(&texts) {
                memory.record(now_ms, 0, &Record::Driver(text));
            }
            let kept = bytes(&memory);
            let records: Vec<_> = RecordReader(&kept).collect::<Option<_>>().unwrap();
            let cut: Vec<_> = texts.iter().map(|text| &text[..text.len().min(120)]).collect();
            let first = texts.len() - records.len();
            for (number, Stamped { now_ms, record }) in (first..).zip(records) {
                prop_assert_eq!(now_ms as usize, number);
                prop_assert_eq!(record, Record::Driver(cut[number]));
            }
            // The next older record would not have fitted.
            prop_assert!(first == 0 || kept.len() + cut[first - 1].len() + OVERHEAD >= RING);
            prop_assert_eq!(memory.restart(0), Found::Records);
        }

        /// Any contents at power-on: the memory is set up anew, or holds what a program left.
        #[test]
        fn anything_can_be_found(words in any::<[u32; 5]>(), marked: bool, filling in prop::collection::vec(any::<u8>(), 1..300)) {
            let memory = RecordMemory::new();
            for (place, byte) in memory.ring.iter().zip(filling.iter().cycle()) {
                place.store(*byte, Ordering::Relaxed);
            }
            let [marker, a, b, c, d] = words;
            memory.marker.store(if marked { MARKER } else { marker }, Ordering::Relaxed);
            let ends = if marked { [a, !a, c, d] } else { [a, b, c, d] };
            for (place, word) in memory.ends.iter().flatten().zip(ends) {
                place.store(word, Ordering::Relaxed);
            }
            let found = memory.restart(0);
            prop_assert!(marked || found == Found::Nothing);
            memory.add_last(Some(1), &Record::Halt(b"end"));
            let kept = bytes(&memory);
            let last = RecordReader(&kept).last().flatten();
            prop_assert_eq!(last, Some(Stamped { now_ms: 1, record: Record::Halt(b"end") }));
        }

        /// A reset after any store of a record: all earlier records are there, and the new one
        /// wholly or not at all.
        #[test]
        fn a_reset_may_come_at_any_store(before in prop::collection::vec(any_text(), 0..120), at in 0_usize..4) {
            let memory = RecordMemory::new();
            memory.restart(0);
            for text in &before {
                memory.record(0, 0, &Record::Driver(text));
            }
            let old = bytes(&memory);
            let ends = |memory: &RecordMemory| -> Vec<u32> {
                memory.ends.iter().flatten().map(|word| word.load(Ordering::Relaxed)).collect()
            };
            let old_ends = ends(&memory);
            memory.record(9, 0, &Record::Halt(b"new"));
            let new_ends = ends(&memory);
            // The stores of the ends after the bytes: the first `at` of them have arrived.
            let room_made = old.len() + 10 >= RING;
            prop_assume!(!room_made);
            for (place, (old, new)) in memory.ends.iter().flatten().zip(old_ends.iter().zip(&new_ends)).enumerate().map(|(place, (word, both))| ((place, word), both)) {
                place.1.store(if place.0 < at { *new } else { *old }, Ordering::Relaxed);
            }
            prop_assert_eq!(memory.restart(0), Found::Records);
            let found = bytes(&memory);
            prop_assert!(found == old || found.len() == old.len() + 10 && found.starts_with(&old));
        }
    }
}
