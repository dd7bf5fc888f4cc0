//! Conversion of entries to slots: the producer side of the queue.

use core::marker::PhantomData;

use ferrostep_planner::{StepEntry, StepKind};

use super::dropped::{DroppedSteps, Left};
use super::held_event::{Following, Newest, StepWords, Usual};
use super::pins::{Pin, PinMap};
use super::player::{MIN_GAP_TICKS, StepPlayer, Stepping};
use super::slot::{Head, MAX_EVENTS, Numbering};
use super::{IDLE_TICKS, StepLink};

/// Maximum number of slots taken by one entry, unless it has more events than a slot holds: a
/// direction change, the first step after it, the others.
pub const MAX_SLOTS_AN_ENTRY: usize = 3;

/// Slots of the ring that no entry takes: one for [`StepFeeder::seal`], and those of the slot in
/// play and the one before, which show after a stop which entries were not played.
const SPARE_SLOTS: usize = 3;

/// Share of the ring that keeps the past, as 1 / this ([`StepFeeder::keeping_past`]).
const PAST_SHARE: usize = 4;

/// Signal timing that the drivers require, in ticks of the timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signals {
    /// Minimum time for which a step signal keeps a level.
    pub pulse_ticks: u32,
    /// Minimum time from a direction change to a step.
    pub direction_setup_ticks: u32,
}

impl Signals {
    /// Limits raised to the minimum that the step interrupt can keep ([`MIN_GAP_TICKS`]): a longer
    /// pulse harms no driver.
    const fn kept(self) -> Self {
        const fn at_least(ticks: u32) -> u32 {
            if ticks < MIN_GAP_TICKS { MIN_GAP_TICKS } else { ticks }
        }
        Self { pulse_ticks: at_least(self.pulse_ticks), direction_setup_ticks: at_least(self.direction_setup_ticks) }
    }
}

/// Reason for which an entry was refused; the queue is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeedError {
    /// The ring is full.
    Full,
    /// The interval is shorter than the pulses, the direction set-up or the interrupt allow.
    TooNear,
}

/// Turns step entries into slots of a [`StepPlayer`].
///
/// The newest event is held back until the next entry gives the interval after it. [`Self::seal`]
/// releases it at the end of a motion.
#[derive(Debug)]
pub struct StepFeeder<'a, M, const PORTS: usize, const N: usize> {
    player: &'a StepPlayer<M, PORTS, N>,
    pins: PinMap<PORTS>,
    signals: Signals,
    words: StepWords<PORTS>,
    /// Threshold: only stairs with intervals above this are usual ([`Usual`]).
    usual_above_ticks: u32,
    /// Slots of the ring that no entry takes.
    spare: usize,
    /// Number of slots filled so far, modulo 2^32; the index of the next slot is the remainder by
    /// the size of the ring.
    filled: u32,
    newest: Newest<PORTS>,
    /// Direction signals at the newest event.
    directions: u8,
    /// Direction signals from the next step on, if they change.
    turning: Option<u8>,
}

impl<'a, M: Stepping, const PORTS: usize, const N: usize> StepFeeder<'a, M, PORTS, N> {
    /// Creates the feeder of a player that has not run yet; it must be the only one. All step
    /// signals are low, direction signals as in [`Self::direction_words`].
    pub fn new(player: &'a StepPlayer<M, PORTS, N>, pins: PinMap<PORTS>, signals: Signals) -> Self {
        let signals = signals.kept();
        player.set_pulse_reload(signals.pulse_ticks - 1);
        let mut feeder = Self {
            player,
            pins,
            signals,
            words: Self::step_words(&pins),
            usual_above_ticks: 0,
            spare: SPARE_SLOTS,
            filled: player.next_number(),
            newest: Newest {
                numbering: Numbering::from(M::EVENTS_A_STEP, player.number_before(player.next_number())),
                // All pins are low, so the next edge of each sets it.
                turning: [0xffff; PORTS],
                held: [0; PORTS],
            },
            directions: 0,
            turning: None,
        };
        feeder.turn(None);
        player.note_directions(0);
        feeder
    }

    fn step_words(pins: &PinMap<PORTS>) -> StepWords<PORTS> {
        core::array::from_fn(|axes| {
            let raised = pins.raised(axes as u8);
            if M::EVENTS_A_STEP == 2 { raised } else { raised.map(|word| word | PinMap::<PORTS>::turned(word)) }
        })
    }

    /// Excludes the step signals of these pins from the next entry on, so that some motors of an
    /// axis stand still while the others move. An empty list lets all motors step again. At
    /// standstill only, and after a stop only once [`Self::drop_all`] has been called.
    pub fn step_without(&mut self, pins: impl Iterator<Item = Pin>) {
        self.words = Self::step_words(&pins.fold(self.pins, PinMap::without_steps));
    }

    /// Keeps a quarter of the ring for the slots played last, for [`StepPlayer::past`]. Otherwise a
    /// planner that is far ahead fills the whole ring with future slots.
    #[must_use]
    pub fn keeping_past(mut self) -> Self {
        self.spare = SPARE_SLOTS + N / PAST_SHARE;
        self
    }

    /// The flags shared with the interrupt.
    pub fn link(&self) -> &StepLink {
        self.player.link()
    }

    /// Number of slots filled so far, modulo 2^32.
    pub fn queued(&self) -> u32 {
        self.filled
    }

    /// Number of slots played so far up to their last event, modulo 2^32.
    pub fn played(&self) -> u32 {
        // In this reading order a slot that ends in between is counted once too often, never once
        // too few.
        let in_play = u32::from(self.player.left() != Head::EMPTY);
        self.filled.wrapping_sub(self.unplayed()).wrapping_sub(in_play)
    }

    /// Number of unplayed slots, including the one in play and the event held back.
    pub fn waiting(&self) -> usize {
        self.filled.wrapping_sub(self.played()) as usize + usize::from(self.is_held())
    }

    /// Number of slots that the interrupt has not begun.
    fn unplayed(&self) -> u32 {
        self.filled.wrapping_sub(self.player.next_number())
    }

    /// True if the newest event changes a pin.
    fn is_held(&self) -> bool {
        self.newest.held != [0; PORTS]
    }

    /// Number of slots that entries may take.
    #[inline]
    fn free(&self) -> usize {
        (N - self.spare).saturating_sub(self.unplayed() as usize)
    }

    /// Minimum number of entries that fit.
    pub fn room(&self) -> usize {
        self.free() / MAX_SLOTS_AN_ENTRY
    }

    /// Adds an entry.
    ///
    /// # Errors
    /// The ring is full, or the entry is closer to the previous one than the drivers allow; the
    /// ring is unchanged.
    #[inline]
    pub fn push(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        self.push_all(&[entry])
    }

    /// Adds entries at less than half the cost of adding them one by one.
    ///
    /// # Errors
    /// As [`Self::push`]; the entries before the refused one were added.
    pub fn push_all(&mut self, entries: &[StepEntry]) -> Result<(), FeedError> {
        self.extend(entries.iter().copied())
    }

    /// Adds entries as an iterator produces them: needs no memory for them, and looks up the values
    /// common to all only once.
    ///
    /// # Errors
    /// As [`Self::push`]; the entries before the refused one were added, and none after it is taken
    /// from `entries`.
    #[inline(always)]
    pub fn extend(&mut self, mut entries: impl Iterator<Item = StepEntry>) -> Result<(), FeedError> {
        // An entry that meets the end of the ring is not usual either.
        while let Some(entry) = self.push_usual(&mut entries) {
            self.push_unusual(entry)?;
        }
        Ok(())
    }

    /// Adds entries while they are usual, there is room for them, and the ring does not wrap.
    /// Returns the first entry that was not added.
    #[inline(always)]
    fn push_usual(&mut self, entries: &mut impl Iterator<Item = StepEntry>) -> Option<StepEntry> {
        let lead_ticks = self.lead_ticks().wrapping_add(1);
        let slots = self.player.slots_from(self.filled);
        // The interrupt can only add room in the meantime.
        let slots = slots.get(..self.free()).unwrap_or(slots);
        let usual = Usual::<M, PORTS> {
            words: &self.words,
            above_ticks: self.usual_above_ticks,
            lead_ticks,
            stepping: PhantomData,
        };
        let mut newest = self.newest;
        let mut left = slots.iter();
        let unusual = usual.push(&mut newest, &mut left, entries);
        self.newest = newest;
        self.filled = self.filled.wrapping_add(slots.len().wrapping_sub(left.len()) as u32);
        unusual
    }

    /// Difference between an interval and the gap after an event, ticks: a pulse, or 0 if both
    /// edges step.
    #[inline(always)]
    fn lead_ticks(&self) -> u32 {
        if M::EVENTS_A_STEP == 2 { self.signals.pulse_ticks } else { 0 }
    }

    /// Adds any entry.
    #[cold]
    #[inline(never)]
    fn push_unusual(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        if self.free() < MAX_SLOTS_AN_ENTRY {
            return Err(FeedError::Full);
        }
        match entry.kind() {
            StepKind::Directions { directions } => self.turn((directions != self.directions).then_some(directions)),
            StepKind::Wait { interval_ticks } => {
                if interval_ticks < self.shortest_interval() {
                    return Err(FeedError::TooNear);
                }
                // With pulses, an event without steps neither begins nor ends a pulse.
                self.fill(interval_ticks, [0; PORTS], 1, [0; PORTS]);
            }
            StepKind::Stair { interval_ticks, count, axes, added } => {
                if interval_ticks < self.shortest_interval() {
                    return Err(FeedError::TooNear);
                }
                // The planner makes no stair long enough to need more.
                let slots = usize::from(count) / (MAX_EVENTS as usize / M::EVENTS_A_STEP as usize) + MAX_SLOTS_AN_ENTRY;
                if self.free() < slots {
                    return Err(FeedError::Full);
                }
                match self.turning {
                    None => self.stair(interval_ticks, count, axes, added),
                    Some(directions) => {
                        self.turn(None);
                        self.turn_and_stair(directions, interval_ticks, count, axes, added);
                    }
                }
            }
        }
        Ok(())
    }

    /// Returns the words for the present direction signals, or for those required before the first
    /// motion.
    pub fn direction_words(&self) -> [u32; PORTS] {
        self.pins.directions(self.directions)
    }

    /// Sets the direction signals of the next step; `None` leaves them unchanged.
    fn turn(&mut self, directions: Option<u8>) {
        self.turning = directions;
        self.usual_above_ticks = match directions {
            Some(_) => u32::MAX,
            None => self.shortest_interval() - 1,
        };
    }

    /// Ends the motion with the newest entry: releases the event that was held back.
    pub fn seal(&mut self) {
        if self.is_held() {
            self.fill(IDLE_TICKS, [0; PORTS], 1, [0; PORTS]);
        }
    }

    /// Starts the player if slots are waiting and it is idle. If it returns true, the caller must
    /// call [`StepPlayer::start_or_end`].
    pub fn start(&mut self) -> bool {
        let idle = self.player.left() == Head::EMPTY && self.unplayed() > 0;
        if idle {
            self.player.motion_begins();
            self.player.link().start();
        }
        idle
    }

    /// Number of timer updates that the interrupt has missed because it was held up for longer than
    /// an interval: the lead of the hardware's update count over the events played, modulo 2^15.
    /// Those events are still owed.
    pub fn missed_updates(&self, update_count: u16) -> u16 {
        // One word, so that both halves are of the same moment.
        let left = self.player.left();
        if left == Head::EMPTY {
            return 0;
        }
        let ahead = update_count.wrapping_sub(left.number().wrapping_sub(left.events() as u16)) & MAX_EVENTS;
        // The count is below the number of events: the board has no such count, or the interrupt
        // came between the two reads.
        if ahead > MAX_EVENTS / 2 { 0 } else { ahead }
    }

    /// Steps that are queued but not yet made by the motors, forwards minus backwards, per motor. A
    /// step that the interrupt makes meanwhile may count as made or not.
    pub fn unplayed_steps(&self) -> [i32; 4] {
        self.left().dropped.signed
    }

    /// Drops everything unplayed, after a stop and while the interrupt is masked.
    ///
    /// Afterwards the caller writes [`Self::rest_words`] to the ports, and the interrupt may run
    /// again.
    pub fn drop_all(&mut self) -> DroppedSteps {
        let Left { mut dropped, odd_axes } = self.left();
        self.newest.turn(self.words_of(odd_axes));
        dropped.requested = self.player.forget(self.filled);
        self.directions = self.turning.unwrap_or(self.directions);
        self.player.note_directions(self.directions);
        self.turn(None);
        self.newest.held = [0; PORTS];
        dropped
    }

    /// The unplayed events.
    fn left(&self) -> Left {
        // Backwards from the end, where the directions are known.
        let mut directions = self.directions;
        let mut left = Left::default();
        if M::EVENTS_A_STEP == 1 {
            left.add_edges(self.pins.stepping(self.newest.held), directions, 1);
        }
        let (next, in_play) = self.next_and_in_play();
        let unplayed = self.filled.wrapping_sub(next);
        for number in 1..=unplayed {
            let number = self.filled.wrapping_sub(number);
            self.add_events(number, self.events_of(number), true, &mut directions, &mut left);
        }
        if in_play > 0 {
            let number = next.wrapping_sub(1);
            self.add_events(number, in_play, in_play == self.events_of(number), &mut directions, &mut left);
        }
        left
    }

    /// Number of all events of a slot, even of one in play, whose head no longer holds that number.
    fn events_of(&self, number: u32) -> u32 {
        let [before, upto] = [number.wrapping_sub(1), number].map(|number| self.player.slot_of(number).head().number());
        (upto.wrapping_sub(before) & MAX_EVENTS).into()
    }

    /// The next slot to be begun, and the remaining events of the one in play, from the same
    /// moment.
    fn next_and_in_play(&self) -> (u32, u32) {
        let mut next = self.player.next_number();
        // The interrupt begins slots less often than this loop iterates; the bound holds whatever
        // the interrupt does.
        for _ in 0..4 {
            let in_play = self.player.left().events();
            let again = self.player.next_number();
            if next == again {
                return (next, in_play);
            }
            next = again;
        }
        (next, 0)
    }

    /// The words that set the signals to the levels that the feeder assumes after
    /// [`Self::drop_all`].
    pub fn rest_words(&self) -> [u32; PORTS] {
        let low = if M::EVENTS_A_STEP == 2 { 0b1111 } else { 0 };
        let mut words = self.pins.raised(low).map(PinMap::<PORTS>::turned);
        for (word, direction) in words.iter_mut().zip(self.pins.directions(self.directions)) {
            *word |= direction;
        }
        words
    }

    /// Adds the last `events` of a slot, including the first event of the slot if `first_too`;
    /// `directions` are the motors' directions before them.
    fn add_events(&self, number: u32, events: u32, first_too: bool, directions: &mut u8, left: &mut Left) {
        let slot = self.player.slot_of(number);
        let first: [u32; PORTS] = core::array::from_fn(|port| slot.first(port));
        let then = self.pins.stepping(core::array::from_fn(|port| slot.then(port)));
        if M::EVENTS_A_STEP == 2 {
            // Every second event, including the last, starts a pulse; the first ends the pulse of a
            // step already made.
            left.dropped.add(then, *directions, events.div_ceil(2));
        } else {
            left.add_edges(then, *directions, events.saturating_sub(first_too.into()));
            left.add_edges(self.pins.stepping(first), *directions, first_too.into());
        }
        if first_too {
            *directions ^= self.pins.turning(first);
        }
    }

    /// The words that step these motors.
    fn words_of(&self, axes: u8) -> [u32; PORTS] {
        self.words[usize::from(axes & 15)]
    }

    fn shortest_interval(&self) -> u32 {
        let Signals { pulse_ticks, direction_setup_ticks } = self.signals;
        let levels = pulse_ticks.saturating_mul(M::EVENTS_A_STEP);
        if self.turning.is_none() {
            return levels;
        }
        // With pulses the direction changes at the end of the previous pulse, otherwise in a
        // separate event.
        let before = if M::EVENTS_A_STEP == 2 { pulse_ticks } else { MIN_GAP_TICKS };
        levels.max(before.saturating_add(direction_setup_ticks))
    }

    /// Adds a stair of any kind in the present directions.
    fn stair(&mut self, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        if M::EVENTS_A_STEP == 1 {
            self.edges(interval_ticks, count, axes, added);
            return;
        }
        if added == 0 {
            self.pulses(interval_ticks, count, axes);
            return;
        }
        // The last pulse differs from the others.
        if count > 1 {
            self.pulses(interval_ticks, count - 1, axes);
        }
        self.pulses(interval_ticks, 1, axes ^ added);
    }

    /// Fills slots for `count` events that step at both edges; the last event is held back.
    fn edges(&mut self, interval_ticks: u32, mut count: u16, axes: u8, added: u8) {
        while count > MAX_EVENTS {
            self.edges_in_a_slot(interval_ticks, MAX_EVENTS, axes, 0);
            count -= MAX_EVENTS;
        }
        self.edges_in_a_slot(interval_ticks, count, axes, added);
    }

    fn edges_in_a_slot(&mut self, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        let (words, last) = (self.words_of(axes), self.words_of(axes ^ added));
        let (then, held) = self.newest.edges(count.into(), words, last);
        self.fill(interval_ticks, then, count, held);
    }

    /// Fills slots for `count` pulses; the end of the last one is held back.
    fn pulses(&mut self, interval_ticks: u32, mut count: u16, axes: u8) {
        let rise = self.words_of(axes);
        let held = rise.map(PinMap::<PORTS>::turned);
        while count > MAX_EVENTS / 2 {
            self.fill(interval_ticks, rise, MAX_EVENTS / 2, held);
            count -= MAX_EVENTS / 2;
        }
        self.fill(interval_ticks, rise, count, held);
    }

    /// Adds the first stair in a new direction.
    fn turn_and_stair(&mut self, directions: u8, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        // Unchanged signals are left out, so that the words tell a stop which signals have changed.
        let changed = self.pins.direction_pins(self.directions ^ directions);
        let mut words = self.pins.directions(directions);
        for (word, changed) in words.iter_mut().zip(changed) {
            *word &= changed | PinMap::<PORTS>::turned(changed);
        }
        self.directions = directions;
        self.player.note_directions(directions);
        if M::EVENTS_A_STEP == 2 {
            // The signals change with the end of the previous pulse.
            for (word, direction) in self.newest.held.iter_mut().zip(words) {
                *word |= direction;
            }
            self.stair(interval_ticks, count, axes, added);
            return;
        }
        // A separate event, halfway or as late as the set-up time allows.
        let before = (interval_ticks / 2).min(interval_ticks - self.signals.direction_setup_ticks);
        self.fill(before, [0; PORTS], 1, words);
        let rest = interval_ticks - before;
        if count == 1 {
            self.edges(rest, 1, axes, added);
        } else {
            self.edges(rest, 1, axes, 0);
            self.edges(interval_ticks, count - 1, axes, added);
        }
    }

    /// Fills a slot with the event that was held back and `steps_in_it` steps, the last of which
    /// (or the end of its pulse) is left for `held`.
    fn fill(&mut self, interval_ticks: u32, then: [u32; PORTS], steps_in_it: u16, held: [u32; PORTS]) {
        let gap_ticks = interval_ticks - self.lead_ticks();
        let events = u32::from(steps_in_it) * M::EVENTS_A_STEP;
        let slot = self.player.slot_of(self.filled);
        self.newest.fill(slot, Following { reload: gap_ticks - 1, then, events, held });
        self.filled = self.filled.wrapping_add(1);
    }
}
