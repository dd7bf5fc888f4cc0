//! The newest event, held back, and the slots filled when its successor arrives.

use core::marker::PhantomData;
use core::slice::Iter;

use ferrostep_planner::StepEntry;

use super::pins::PinMap;
use super::player::Stepping;
use super::slot::{Filling, Numbering, Slot};

/// State that every slot changes. It is small enough to stay in registers while many slots are
/// filled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Newest<const PORTS: usize> {
    /// Count of the events in the slots filled so far.
    pub(super) numbering: Numbering,
    /// Both edges: the words that would toggle every pin of the ports after the newest event.
    pub(super) turning: [u32; PORTS],
    /// Words of the newest event, which waits for the interval after it: zeros if the event changes
    /// no pin.
    pub(super) held: [u32; PORTS],
}

/// Events that follow the one held back.
pub(super) struct Following<const PORTS: usize> {
    /// Reload value for the gap between the events; with pulses, for the low part of it.
    pub(super) reload: u32,
    /// Words of the first event.
    pub(super) then: [u32; PORTS],
    /// Number of events.
    pub(super) events: u32,
    /// Words of the last event, which the slot leaves to the next one.
    pub(super) held: [u32; PORTS],
}

/// Words that step each set of motors: with pulses they raise the signals, with both edges they
/// select from [`Newest::turning`].
pub(super) type StepWords<const PORTS: usize> = [[u32; PORTS]; 16];

/// State that is constant while the directions are.
pub(super) struct Usual<'a, M, const PORTS: usize> {
    pub(super) words: &'a StepWords<PORTS>,
    /// Intervals above this are usual.
    pub(super) above_ticks: u32,
    /// Difference between an interval and its reload value.
    pub(super) lead_ticks: u32,
    pub(super) stepping: PhantomData<M>,
}

impl<M: Stepping, const PORTS: usize> Usual<'_, M, PORTS> {
    /// Adds entries while they are usual stairs and slots are free. A usual stair keeps the
    /// directions, and its events are neither too close together nor too many for a slot. Returns
    /// the first other entry, which was not added.
    #[inline(always)]
    pub(super) fn push(
        &self,
        newest: &mut Newest<PORTS>,
        slots: &mut Iter<'_, Slot<PORTS>>,
        entries: &mut impl Iterator<Item = StepEntry>,
    ) -> Option<StepEntry> {
        if M::EVENTS_A_STEP == 1 {
            self.push_edges(newest, slots, entries)
        } else {
            self.push_pulses(newest, slots, entries)
        }
    }

    /// Adds stairs that step at both edges: one slot per entry.
    #[inline(always)]
    fn push_edges(
        &self,
        newest: &mut Newest<PORTS>,
        slots: &mut Iter<'_, Slot<PORTS>>,
        entries: &mut impl Iterator<Item = StepEntry>,
    ) -> Option<StepEntry> {
        for entry in entries.by_ref() {
            let [interval_ticks, word] = entry.to_words();
            if interval_ticks <= self.above_ticks || !entry.is_short_stair() {
                return Some(entry);
            }
            let Some(slot) = slots.next() else { return Some(entry) };
            let (then, held) = newest.edges(word, self.words(word >> 16), self.words((word ^ word << 8) >> 24));
            let reload = interval_ticks.wrapping_sub(self.lead_ticks);
            newest.fill(slot, Following { reload, then, events: word & 0xffff, held });
        }
        None
    }

    /// Adds pulses: the last pulse of a stair may differ and then takes a separate slot.
    #[inline(always)]
    fn push_pulses(
        &self,
        newest: &mut Newest<PORTS>,
        slots: &mut Iter<'_, Slot<PORTS>>,
        entries: &mut impl Iterator<Item = StepEntry>,
    ) -> Option<StepEntry> {
        for entry in entries.by_ref() {
            if entry.interval_ticks() <= self.above_ticks {
                return Some(entry);
            }
            let (reload, word) = (entry.interval_ticks().wrapping_sub(self.lead_ticks), entry.stair_word());
            let mut last = word >> 16;
            if !entry.is_single() {
                if !entry.is_short_stair() || slots.len() < 2 {
                    return Some(entry);
                }
                let has_other = word >> 24 != 0;
                let alike = (word & 0xffff).wrapping_sub(u32::from(has_other));
                if alike > 0
                    && let Some(slot) = slots.next()
                {
                    let then = self.words(last);
                    let held = then.map(PinMap::<PORTS>::turned);
                    newest.fill(slot, Following { reload, then, events: alike * M::EVENTS_A_STEP, held });
                }
                if !has_other {
                    continue;
                }
                last ^= word >> 24;
            }
            let Some(slot) = slots.next() else { return Some(entry) };
            let then = self.words(last);
            newest.fill_step::<M>(slot, reload, then, then.map(PinMap::<PORTS>::turned));
        }
        None
    }

    /// The words that step the motors in the lowest bits of `axes`.
    #[inline(always)]
    fn words(&self, axes: u32) -> [u32; PORTS] {
        self.words[axes as usize & 15]
    }
}

impl<const PORTS: usize> Newest<PORTS> {
    /// Both edges: the words of an event that steps the motors selected by `words`.
    #[inline(always)]
    pub(super) fn turn(&mut self, words: [u32; PORTS]) -> [u32; PORTS] {
        let mut event = words;
        for (event, turning) in event.iter_mut().zip(&mut self.turning) {
            let word = *event;
            *event &= *turning;
            *turning ^= word;
        }
        event
    }

    /// Both edges: the words of the first and the last event of a stair.
    #[inline(always)]
    pub(super) fn edges(
        &mut self,
        count: u32,
        words: [u32; PORTS],
        last: [u32; PORTS],
    ) -> ([u32; PORTS], [u32; PORTS]) {
        let mut then = words;
        for (then, turning) in then.iter_mut().zip(&mut self.turning) {
            let word = *then;
            *then &= *turning;
            *turning ^= if count & 1 == 0 { word } else { 0 };
        }
        (then, self.turn(last))
    }

    /// Fills a slot with the event that was held back and a step; the end of that step, `held`, is
    /// the next event to be held back.
    #[inline(always)]
    fn fill_step<M: Stepping>(&mut self, slot: &Slot<PORTS>, reload: u32, then: [u32; PORTS], held: [u32; PORTS]) {
        self.numbering.advance(M::EVENTS_A_STEP);
        slot.fill(&Filling { first: self.held, then, reload, head: self.numbering.head_of_step() });
        self.held = held;
    }

    /// Fills a slot with the event that was held back and all following events but the last.
    #[inline(always)]
    pub(super) fn fill(&mut self, slot: &Slot<PORTS>, following: Following<PORTS>) {
        let Following { reload, then, events, held } = following;
        self.numbering.advance(events);
        let head = self.numbering.head(events);
        slot.fill(&Filling { first: self.held, then, reload, head });
        self.held = held;
    }
}
