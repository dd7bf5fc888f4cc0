//! A slot of the ring between planner task and step interrupt.

use super::word::{WordU16, WordU32};

/// Most events in one slot.
pub const MOST_EVENTS: u16 = 0x7fff;

/// Set in a slot's head when its events are nearer than leaving and entering the interrupt would take.
const NEAR: u16 = 0x8000;

/// Events with one interval. Its head doubles as its full flag: the producer stores it last, the interrupt clears it
/// when the slot's last event is out.
#[derive(Debug)]
pub struct Slot<const PORTS: usize> {
    /// The word to store to each port at the first event; at the others the same turned by 16 bits each time, so that
    /// what one sets the next resets.
    first: [WordU32; PORTS],
    /// The words of the last event.
    last: [WordU32; PORTS],
    /// Reload value for the gaps of the slot behind this one.
    next_reload: WordU32,
    /// Number of events, 0 = empty, and [`NEAR`].
    head: WordU16,
    /// Number of all events up to the end of this slot, modulo 2^15.
    number: WordU16,
}

/// A slot's contents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filling<const PORTS: usize> {
    /// See [`Slot::first`].
    pub first: [u32; PORTS],
    /// See [`Slot::last`].
    pub last: [u32; PORTS],
    /// See [`Slot::next_reload`].
    pub next_reload: u32,
    /// Number of events, 1 to [`MOST_EVENTS`].
    pub events: u16,
    /// See [`NEAR`].
    pub near: bool,
    /// See [`Slot::number`].
    pub number: u16,
}

/// What the head of a full slot says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Head {
    /// Nothing is there.
    Empty,
    /// Events far enough apart to leave the interrupt in between.
    Far {
        /// How many, less one.
        but_one: i32,
    },
    /// Events so near that the interrupt stays for them.
    Near {
        /// How many, less one.
        but_one: i32,
    },
}

impl<const PORTS: usize> Slot<PORTS> {
    /// An empty slot.
    pub const EMPTY: Self = Self {
        first: [const { WordU32::new(0) }; PORTS],
        last: [const { WordU32::new(0) }; PORTS],
        next_reload: WordU32::new(0),
        head: WordU16::new(0),
        number: WordU16::new(0),
    };

    /// For the producer: fills an empty slot; the interrupt may take it at once.
    #[inline]
    pub fn fill(&self, filling: &Filling<PORTS>) {
        for (word, value) in self.first.iter().zip(filling.first) {
            word.store(value);
        }
        for (word, value) in self.last.iter().zip(filling.last) {
            word.store(value);
        }
        self.next_reload.store(filling.next_reload);
        self.number.store(filling.number);
        super::word::publish();
        self.head.store(filling.events & MOST_EVENTS | if filling.near { NEAR } else { 0 });
    }

    /// How many events, and how near.
    #[inline(always)]
    pub fn head(&self) -> Head {
        // One comparison for the usual case: neither empty nor near.
        let head = i32::from(self.head.load() as i16);
        super::word::acquire();
        let but_one = head - 1;
        if but_one >= 0 {
            Head::Far { but_one }
        } else if head == 0 {
            Head::Empty
        } else {
            Head::Near { but_one: (head & i32::from(MOST_EVENTS)) - 1 }
        }
    }

    /// The words of the first event.
    #[inline(always)]
    pub fn first(&self, port: usize) -> u32 {
        self.first[port].load()
    }

    /// The words of the last event.
    #[inline(always)]
    pub fn last(&self, port: usize) -> u32 {
        self.last[port].load()
    }

    /// Reload value for the gaps of the slot behind.
    #[inline(always)]
    pub fn next_reload(&self) -> u32 {
        self.next_reload.load()
    }

    /// Number of all events up to the end of this slot, modulo 2^15.
    #[inline(always)]
    pub fn number(&self) -> u16 {
        self.number.load()
    }

    /// Its last event is out.
    #[inline(always)]
    pub fn clear(&self) {
        self.head.store(0);
    }
}
