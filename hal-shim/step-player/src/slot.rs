//! A slot of the ring between planner task and step interrupt.

use super::shared_word::{WordI32, WordU32};

/// Maximum number of events in one slot; events are numbered modulo this + 1.
pub const MAX_EVENTS: u16 = 0x7fff;

/// Events separated by a constant interval. The slot's head doubles as its full flag: the producer
/// stores it last, the interrupt clears it when it has copied the rest.
#[derive(Debug)]
pub struct Slot<const PORTS: usize> {
    /// Words to store to the ports at the first event: the last event of the previous stair.
    first: [WordU32; PORTS],
    /// Words of the second event; each later event has the same words with the halves swapped once
    /// more, so that it resets the pins that the one before has set.
    then: [WordU32; PORTS],
    /// Reload value for the gaps after the events.
    reload: WordU32,
    /// Upper half: minus the number of events; 0 for an empty slot. Lower half: number of all
    /// events up to the end of this slot, modulo 2^15, which stays when the slot has been played.
    head: WordI32,
}

/// Contents of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filling<const PORTS: usize> {
    /// Value of [`Slot::first`].
    pub first: [u32; PORTS],
    /// Value of [`Slot::then`].
    pub then: [u32; PORTS],
    /// Value of [`Slot::reload`].
    pub reload: u32,
    /// Value of [`Slot::head`].
    pub head: Head,
}

/// Head of a slot. While the slot is played, the upper half counts the remaining events up to 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head(pub i32);

impl Head {
    /// One event in a head.
    pub const EVENT: i32 = 1 << 16;

    /// Head while no slot is being played.
    pub const EMPTY: Self = Self(0);

    /// Returns true if events remain.
    #[inline(always)]
    pub fn is_filled(self) -> bool {
        self.0 < 0
    }

    /// Number of remaining events.
    pub fn events(self) -> u32 {
        (self.0 >> 16).unsigned_abs()
    }

    /// Number of all events up to the end of the slot, modulo 2^15.
    pub fn number(self) -> u16 {
        self.0 as u16
    }
}

/// Number of all events up to the end of the slot filled last, modulo 2^15, kept in the upper 15
/// bits, where it wraps by itself. The lower bits are the upper bits of the head of a one-step
/// slot; that head is this word rotated by 17 bits.
#[derive(Clone, Copy, Debug)]
pub struct Numbering(u32);

impl Numbering {
    /// Lowest bit of the number.
    const SHIFT: u32 = 17;

    /// Starts at no events, for steps of this many events.
    pub const fn new(events_a_step: u32) -> Self {
        Self((events_a_step << 16).wrapping_neg() >> 15)
    }

    /// Continues the numbering of [`Self::new`] after this many events, modulo 2^15.
    pub const fn from(events_a_step: u32, number: u16) -> Self {
        Self(Self::new(events_a_step).0.wrapping_add((number as u32) << Self::SHIFT))
    }

    /// Counts this many further events.
    #[inline(always)]
    pub fn advance(&mut self, events: u32) {
        self.0 = self.0.wrapping_add(events << Self::SHIFT);
    }

    /// The head of a one-step slot that ends here.
    #[inline(always)]
    pub fn head_of_step(self) -> Head {
        Head(self.0.rotate_right(Self::SHIFT) as i32)
    }

    /// The head of a slot of 1 to [`MAX_EVENTS`] events that ends here.
    #[inline(always)]
    pub fn head(self, events: u32) -> Head {
        Head((self.0 >> Self::SHIFT).wrapping_sub(events << 16) as i32)
    }
}

impl<const PORTS: usize> Slot<PORTS> {
    /// An empty slot.
    pub const fn empty() -> Self {
        Self {
            first: [const { WordU32::new(0) }; PORTS],
            then: [const { WordU32::new(0) }; PORTS],
            reload: WordU32::new(0),
            head: WordI32::new(0),
        }
    }

    /// Fills an empty slot, for the producer; the interrupt may take it at once.
    #[inline(always)]
    pub fn fill(&self, filling: &Filling<PORTS>) {
        for (word, value) in self.first.iter().zip(filling.first) {
            word.store(value);
        }
        for (word, value) in self.then.iter().zip(filling.then) {
            word.store(value);
        }
        self.reload.store(filling.reload);
        super::shared_word::publish();
        self.head.store(filling.head.0);
    }

    /// Number of events in the slot, and the number of all events up to its end.
    #[inline(always)]
    pub fn head(&self) -> Head {
        let head = self.head.load();
        super::shared_word::acquire();
        Head(head)
    }

    /// The words of the first event, by port.
    #[inline(always)]
    pub fn first(&self, port: usize) -> u32 {
        self.first[port].load()
    }

    /// The words of the second event, by port.
    #[inline(always)]
    pub fn then(&self, port: usize) -> u32 {
        self.then[port].load()
    }

    /// Reload value for the gaps after the events.
    #[inline(always)]
    pub fn reload(&self) -> u32 {
        self.reload.load()
    }

    /// Empties the slot, whose present head is `head`.
    #[inline(always)]
    pub fn clear(&self, head: Head) {
        self.head.store(head.0 & 0xffff);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_head_of_a_step_is_that_of_its_events() {
        for events in [1, 2] {
            let mut numbering = Numbering::new(events);
            for _ in 0..70_000 {
                numbering.advance(events);
                assert_eq!(numbering.head_of_step(), numbering.head(events));
            }
        }
    }

    #[test]
    fn a_head_tells_events_and_number_and_the_latter_stays() {
        let mut numbering = Numbering::new(2);
        numbering.advance(0x7ffe);
        numbering.advance(9);
        let head = numbering.head(9);
        assert_eq!((head.events(), head.number(), head.is_filled()), (9, 7, true));
        let slot = Slot::<1>::empty();
        assert!(!slot.head().is_filled());
        slot.clear(head);
        assert!(!slot.head().is_filled());
        assert_eq!(slot.head().number(), 7);
    }
}
