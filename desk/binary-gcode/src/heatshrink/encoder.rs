//! Compresses a block: takes the longest of the newest repetitions, byte by byte.

use alloc::vec;
use alloc::vec::Vec;

use super::COUNT_BITS;

/// Maximum number of bytes of a repetition.
const MAX_COUNT: usize = 1 << COUNT_BITS;

/// Minimum number of bytes of a repetition that is looked for.
const MIN_COUNT: usize = 3;

/// Maximum number of places that are compared for one repetition.
const MAX_TRIES: usize = 64;

/// Bits of a hash of [`MIN_COUNT`] bytes.
const HASH_BITS: u32 = 13;

/// The place of no byte.
const NONE: u32 = u32::MAX;

/// Compresses data for a window of this many bits.
pub(crate) fn compress(data: &[u8], window_bits: u8) -> Vec<u8> {
    let mut bits = Bits::default();
    let mut places = Places { data, newest: vec![NONE; 1 << HASH_BITS], before: vec![NONE; data.len()] };
    let mut at = 0;
    while let Some(&byte) = data.get(at) {
        let (distance, count) = places.longest(at, (1 << window_bits) - 1);
        let used = if count >= MIN_COUNT {
            bits.put(0, 1);
            bits.put(distance as u32 - 1, window_bits);
            bits.put(count as u32 - 1, COUNT_BITS);
            count
        } else {
            bits.put(1, 1);
            bits.put(byte.into(), 8);
            1
        };
        (at..at + used).for_each(|place| places.add(place));
        at += used;
    }
    bits.end()
}

/// The places of all bytes so far, by a hash of the bytes from there on.
struct Places<'a> {
    data: &'a [u8],
    newest: Vec<u32>,
    /// The place before each with the same hash.
    before: Vec<u32>,
}

impl Places<'_> {
    fn hash(&self, at: usize) -> Option<usize> {
        let bytes = self.data.get(at..)?.first_chunk::<MIN_COUNT>()?;
        let word = bytes.iter().fold(0_u32, |word, byte| word << 8 | u32::from(*byte));
        Some((word.wrapping_mul(0x9e37_79b1) >> (u32::BITS - HASH_BITS)) as usize)
    }

    fn add(&mut self, at: usize) {
        let Some(hash) = self.hash(at) else { return };
        if let (Some(newest), Some(before)) = (self.newest.get_mut(hash), self.before.get_mut(at)) {
            *before = core::mem::replace(newest, at as u32);
        }
    }

    /// Distance and count of the longest repetition from a place on; the nearest of equal ones.
    fn longest(&self, at: usize, max_distance: usize) -> (usize, usize) {
        let (mut best, mut tries) = ((0, 0), 0);
        let mut place = self.hash(at).and_then(|hash| self.newest.get(hash)).copied().unwrap_or(NONE);
        while place != NONE && at - place as usize <= max_distance && tries < MAX_TRIES && best.1 < MAX_COUNT {
            let here = self.data.get(at..).unwrap_or_default().iter().take(MAX_COUNT);
            let there = self.data.get(place as usize..).unwrap_or_default();
            let count = here.zip(there).take_while(|(one, other)| one == other).count();
            if count > best.1 {
                best = (at - place as usize, count);
            }
            place = self.before.get(place as usize).copied().unwrap_or(NONE);
            tries += 1;
        }
        best
    }
}

/// Bits, the highest first.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    word: u32,
    held: u8,
}

impl Bits {
    fn put(&mut self, bits: u32, count: u8) {
        (self.word, self.held) = (self.word << count | bits, self.held + count);
        while self.held >= 8 {
            self.held -= 8;
            self.bytes.push((self.word >> self.held) as u8);
        }
    }

    /// The last byte is filled with zeros, which are too few for another item.
    fn end(mut self) -> Vec<u8> {
        if self.held > 0 {
            self.put(0, 8 - self.held);
        }
        self.bytes
    }
}
