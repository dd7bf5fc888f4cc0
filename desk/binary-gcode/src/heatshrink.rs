//! Heatshrink: literals and repetitions, bit by bit.
//!
//! A 1 and eight bits are a byte; a 0, the distance less one and the count less one (4 bits) repeat
//! bytes of the window; the highest bit comes first. Before the first byte the window holds zeros.
//! Source: <https://github.com/atomicobject/heatshrink>.

/// Bits of the largest window.
const MAX_WINDOW_BITS: u8 = 12;

/// Bytes of the largest window.
const WINDOW_BYTES: usize = 1 << MAX_WINDOW_BITS;

/// Bits of a repetition's count.
const COUNT_BITS: u8 = 4;

#[cfg(feature = "write")]
pub(crate) mod encoder;

/// A decompressor of one block.
#[derive(Clone)]
pub(crate) struct Heatshrink {
    window: [u8; WINDOW_BYTES],
    window_bits: u8,
    /// Place of the next byte in the window.
    head: usize,
    /// Bits that have arrived and are not used yet, the lowest `held` of them.
    bits: u32,
    held: u8,
    /// The first bit of the next item: a literal, or a repetition.
    is_literal: Option<bool>,
    distance: usize,
    /// Bytes that are still to be repeated.
    repeats: u32,
}

impl Heatshrink {
    /// Creates a decoder at the start of a block, with the largest window.
    pub const fn new() -> Self {
        Self {
            window: [0; WINDOW_BYTES],
            window_bits: MAX_WINDOW_BITS,
            head: 0,
            bits: 0,
            held: 0,
            is_literal: None,
            distance: 0,
            repeats: 0,
        }
    }

    /// Begins a block with a window of this many bits, 12 at most.
    pub fn restart(&mut self, window_bits: u8) {
        self.window.fill(0);
        self.window_bits = window_bits.min(MAX_WINDOW_BITS);
        (self.head, self.bits, self.held, self.is_literal) = (0, 0, 0, None);
        (self.distance, self.repeats) = (0, 0);
    }

    /// The next byte, or `None` after it has taken all of `input`.
    pub fn next(&mut self, input: &mut &[u8]) -> Option<u8> {
        loop {
            if self.repeats > 0 {
                self.repeats -= 1;
                let place = self.head.wrapping_sub(self.distance) % WINDOW_BYTES;
                return Some(self.keep(self.window.get(place).copied().unwrap_or_default()));
            }
            match self.is_literal {
                None => self.is_literal = Some(self.take(1, input)? == 1),
                Some(true) => {
                    let byte = self.take(8, input)? as u8;
                    self.is_literal = None;
                    return Some(self.keep(byte));
                }
                Some(false) => {
                    let word = self.take(self.window_bits + COUNT_BITS, input)?;
                    self.distance = (word >> COUNT_BITS) as usize + 1;
                    self.repeats = (word & ((1 << COUNT_BITS) - 1)) + 1;
                    self.is_literal = None;
                }
            }
        }
    }

    /// Adds a byte to the window. A smaller one uses part of it: no distance reaches further.
    fn keep(&mut self, byte: u8) -> u8 {
        if let Some(place) = self.window.get_mut(self.head) {
            *place = byte;
        }
        self.head = (self.head + 1) % WINDOW_BYTES;
        byte
    }

    /// The next bits, 16 at most; `None` if `input` has ended before them.
    fn take(&mut self, count: u8, input: &mut &[u8]) -> Option<u32> {
        while self.held < count {
            let (&byte, rest) = input.split_first()?;
            *input = rest;
            self.bits = self.bits << 8 | u32::from(byte);
            self.held += 8;
        }
        self.held -= count;
        let word = self.bits >> self.held & ((1 << count) - 1);
        self.bits &= (1 << self.held) - 1;
        Some(word)
    }
}
