//! Entries to slots: the producer's side of the queue.

use ferrostep_planner::{StepEntry, StepKind};

use super::pins::PinMap;
use super::player::{NEAR_TICKS, StepPlayer, Stepping};
use super::slot::{Filling, Head, MOST_EVENTS};
use super::{IDLE_TICKS, StepLink};

/// Most slots that one entry takes: a direction change, the first step after it, the others.
pub const MOST_SLOTS_AN_ENTRY: usize = 3;

/// What the drivers ask of the signals, in ticks of the timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signals {
    /// Shortest time that a step signal stays at a level.
    pub pulse_ticks: u32,
    /// Shortest time from a direction change to a step.
    pub direction_setup_ticks: u32,
}

/// Why an entry was not taken. Nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeedError {
    /// The ring is full.
    Full,
    /// Its interval is shorter than pulses and direction set-up allow.
    TooNear,
}

/// Steps that were in the queue when motion was stopped: signed by direction, and both directions added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DroppedSteps {
    /// Forwards minus backwards, a motor each.
    pub signed: [i32; 4],
    /// All, a motor each.
    pub issued: [u32; 4],
}

impl DroppedSteps {
    fn add(&mut self, steps: Steps, count: u32) {
        for (motor, (signed, issued)) in self.signed.iter_mut().zip(&mut self.issued).enumerate() {
            if steps.axes >> motor & 1 != 0 {
                *issued = issued.wrapping_add(count);
                let backwards = steps.directions >> motor & 1 != 0;
                let count = count as i32;
                *signed = signed.wrapping_add(if backwards { count.wrapping_neg() } else { count });
            }
        }
    }
}

/// What an event steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Steps {
    axes: u8,
    directions: u8,
}

impl Steps {
    const NONE: Self = Self { axes: 0, directions: 0 };
}

/// What a slot holds, for the accounts after a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotAccount {
    /// Its first event.
    first: Steps,
    /// The others.
    then: Steps,
    events: u16,
}

impl SlotAccount {
    /// No events.
    pub const NONE: Self = Self { first: Steps::NONE, then: Steps::NONE, events: 0 };
}

/// An event that waits for the interval behind it.
#[derive(Clone, Copy, Debug)]
struct Held<const PORTS: usize> {
    words: [u32; PORTS],
    /// What it steps; of a pulse's end nothing, its start has stepped.
    steps: Steps,
    /// Whether there is anything to be seen of it on the pins.
    counts: bool,
}

/// Turns step entries into slots of a [`StepPlayer`].
///
/// The newest event is held back until the next entry tells the interval behind it. [`Self::seal`] lets it go at the end
/// of a motion.
#[derive(Debug)]
pub struct StepFeeder<'a, M, const PORTS: usize, const N: usize> {
    player: &'a StepPlayer<M, PORTS, N>,
    pins: PinMap<PORTS>,
    signals: Signals,
    /// Slots filled so far, modulo 2^32; the place of the next is its remainder by `N`.
    filled: u32,
    /// Events in them, modulo 2^15.
    number: u16,
    /// Both edges: the level of each step signal after the newest event.
    levels: u8,
    /// Direction signals at the newest event.
    directions: u8,
    /// Direction signals from the next step on.
    turning: Option<u8>,
    held: Held<PORTS>,
    accounts: &'a mut [SlotAccount; N],
}

impl<'a, M: Stepping, const PORTS: usize, const N: usize> StepFeeder<'a, M, PORTS, N> {
    /// The feeder of a player that has not run yet; there must be no other. All signals are low. `accounts` is memory to
    /// keep books in.
    pub fn new(
        player: &'a StepPlayer<M, PORTS, N>,
        pins: PinMap<PORTS>,
        signals: Signals,
        accounts: &'a mut [SlotAccount; N],
    ) -> Self {
        let signals = Signals { pulse_ticks: signals.pulse_ticks.max(2), ..signals };
        player.set_pulse_reload(signals.pulse_ticks - 1);
        Self {
            player,
            pins,
            signals,
            filled: player.next_number(),
            number: 0,
            levels: 0,
            directions: 0,
            turning: None,
            held: Self::nothing(),
            accounts,
        }
    }

    /// The flags shared with the interrupt.
    pub fn link(&self) -> &StepLink {
        self.player.link()
    }

    /// Slots filled so far, modulo 2^32.
    pub fn queued(&self) -> u32 {
        self.filled
    }

    /// Slots played so far to their last event, modulo 2^32.
    pub fn played(&self) -> u32 {
        // Read in this order, a slot that ends in between is counted once too often, never once too few.
        let in_play = u32::from(self.player.left() != Head::EMPTY);
        self.filled.wrapping_sub(self.unplayed()).wrapping_sub(in_play)
    }

    /// Slots that have not been played, the one in play and the event held back included.
    pub fn waiting(&self) -> usize {
        self.filled.wrapping_sub(self.played()) as usize + usize::from(self.held.counts)
    }

    /// Slots that the interrupt has not begun.
    fn unplayed(&self) -> u32 {
        self.filled.wrapping_sub(self.player.next_number())
    }

    /// How many entries fit at least.
    pub fn room(&self) -> usize {
        N.saturating_sub(self.unplayed() as usize) / MOST_SLOTS_AN_ENTRY
    }

    /// Adds an entry.
    ///
    /// # Errors
    /// The ring is full, or the entry is nearer to the one before than the drivers allow; nothing was added.
    #[inline]
    pub fn push(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        if self.unplayed() as usize > N - MOST_SLOTS_AN_ENTRY {
            return Err(FeedError::Full);
        }
        match entry.kind() {
            StepKind::Directions { directions } => self.turning = (directions != self.directions).then_some(directions),
            StepKind::Wait { interval_ticks } => {
                if interval_ticks < self.shortest_interval() {
                    return Err(FeedError::TooNear);
                }
                // In pulses an event without steps begins and ends nothing.
                self.fill(interval_ticks, [0; PORTS], Steps::NONE, 1, Self::nothing());
            }
            StepKind::Stair { interval_ticks, count, axes, added } => {
                if interval_ticks < self.shortest_interval() {
                    return Err(FeedError::TooNear);
                }
                match self.turning.take() {
                    None => self.stair(interval_ticks, count, axes, added),
                    Some(directions) => self.turn_and_stair(directions, interval_ticks, count, axes, added),
                }
            }
        }
        Ok(())
    }

    /// The motion ends with the newest entry: what was held back may be played.
    pub fn seal(&mut self) {
        if self.held.counts {
            self.fill(IDLE_TICKS, [0; PORTS], Steps::NONE, 1, Self::nothing());
        }
    }

    /// Whether there is something to play and nothing is being played: then [`StepPlayer::stay`] is to be called.
    pub fn start(&mut self) -> bool {
        let idle = self.player.left() == Head::EMPTY && self.unplayed() > 0;
        if idle {
            self.player.link().start();
        }
        idle
    }

    /// How many updates of the timer the interrupt has missed, because it was held up for longer than an interval: by
    /// how much the hardware's count of updates, modulo 2^15, is ahead of the events played. Those events are owed.
    pub fn missed_updates(&self, update_count: u16) -> u16 {
        // One word, so that both are of the same moment.
        let left = self.player.left();
        if left == Head::EMPTY {
            return 0;
        }
        let ahead = update_count.wrapping_sub(left.number().wrapping_sub(left.events() as u16)) & MOST_EVENTS;
        // Behind, that is: there is no such count, or the interrupt came between the looks.
        if ahead > MOST_EVENTS / 2 { 0 } else { ahead }
    }

    /// While the interrupt is masked, because somebody has stopped motion: forgets what has not been played.
    ///
    /// Afterwards [`Self::rest_words`] belong on the ports, and the interrupt may run again.
    pub fn drop_all(&mut self) -> DroppedSteps {
        let mut dropped = DroppedSteps::default();
        let first = self.filled.wrapping_sub(self.unplayed());
        let left = self.player.left().events();
        if left > 0 {
            self.drop_events(self.account(first.wrapping_sub(1)), left, &mut dropped);
        }
        for number in 0..self.unplayed() {
            let account = self.account(first.wrapping_add(number));
            self.drop_events(account, u32::from(account.events), &mut dropped);
        }
        if M::EVENTS_A_STEP == 1 {
            dropped.add(self.held.steps, 1);
            self.levels ^= self.held.steps.axes;
        }
        self.player.forget(self.filled);
        self.directions = self.turning.take().unwrap_or(self.directions);
        self.held = Self::nothing();
        dropped
    }

    /// The words that put the signals where this side believes them to be after [`Self::drop_all`].
    pub fn rest_words(&self) -> [u32; PORTS] {
        let low = if M::EVENTS_A_STEP == 2 { 0b1111 } else { 0 };
        let mut words = self.pins.steps(0, low);
        for (word, direction) in words.iter_mut().zip(self.pins.directions(self.directions)) {
            *word |= direction;
        }
        words
    }

    fn account(&self, number: u32) -> SlotAccount {
        self.accounts[number as usize & (N - 1)]
    }

    /// The last `events` of a slot are not played.
    fn drop_events(&mut self, account: SlotAccount, events: u32, dropped: &mut DroppedSteps) {
        let SlotAccount { first, then, events: all, .. } = account;
        if M::EVENTS_A_STEP == 2 {
            // Every second event, the last one included, is the start of a pulse; the first ends one that has stepped.
            dropped.add(then, events.div_ceil(2));
            return;
        }
        let first_too = events == u32::from(all);
        let others = if first_too { events.saturating_sub(1) } else { events };
        dropped.add(then, others);
        self.levels ^= if others & 1 == 1 { then.axes } else { 0 };
        if first_too {
            dropped.add(first, 1);
            self.levels ^= first.axes;
        }
    }

    fn shortest_interval(&self) -> u32 {
        let Signals { pulse_ticks, direction_setup_ticks } = self.signals;
        let levels = pulse_ticks * M::EVENTS_A_STEP;
        if self.turning.is_none() {
            return levels;
        }
        // With pulses the direction changes at the end of the pulse before.
        let before = if M::EVENTS_A_STEP == 2 { pulse_ticks } else { 2 };
        levels.max(before + direction_setup_ticks.max(2))
    }

    /// An event without steps.
    const fn nothing() -> Held<PORTS> {
        Held { words: [0; PORTS], steps: Steps::NONE, counts: false }
    }

    #[inline]
    fn stair(&mut self, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        if M::EVENTS_A_STEP == 1 {
            self.edges(interval_ticks, count, axes, added);
            return;
        }
        if added & !axes == 0 {
            self.pulses(interval_ticks, count, axes);
            return;
        }
        // The last pulse is another one.
        if count > 1 {
            self.pulses(interval_ticks, count - 1, axes);
        }
        self.pulses(interval_ticks, 1, axes | added);
    }

    /// Both edges: `count` events, of which the last is held back.
    #[inline]
    fn edges(&mut self, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        let then = self.pins.steps(axes & !self.levels, axes & self.levels);
        let before_last = self.levels ^ if count & 1 == 0 { axes } else { 0 };
        let all = axes | added;
        let words = self.pins.steps(all & !before_last, all & before_last);
        self.levels = before_last ^ all;
        let steps = Steps { axes, directions: self.directions };
        let held = Held { words, steps: Steps { axes: all, ..steps }, counts: true };
        self.fill(interval_ticks, then, steps, count, held);
    }

    /// `count` pulses, of which the last one's end is held back.
    #[inline]
    fn pulses(&mut self, interval_ticks: u32, count: u16, axes: u8) {
        let steps = Steps { axes, directions: self.directions };
        let rise = self.pins.steps(axes, 0);
        let held = Held { words: self.pins.steps(0, axes), steps: Steps::NONE, counts: true };
        let half = MOST_EVENTS / 2;
        if count > half {
            self.fill(interval_ticks, rise, steps, half, held);
            self.fill(interval_ticks, rise, steps, count - half, held);
        } else {
            self.fill(interval_ticks, rise, steps, count, held);
        }
    }

    /// The first stair in a new direction.
    fn turn_and_stair(&mut self, directions: u8, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        self.directions = directions;
        let words = self.pins.directions(directions);
        if M::EVENTS_A_STEP == 2 {
            // The signals change with the end of the pulse before.
            for (word, direction) in self.held.words.iter_mut().zip(words) {
                *word |= direction;
            }
            self.stair(interval_ticks, count, axes, added);
            return;
        }
        // Half way, or as late as the set-up time allows: an event of its own.
        let before = (interval_ticks / 2).min(interval_ticks - self.signals.direction_setup_ticks.max(2)).max(2);
        let turn = Held { words, steps: Steps::NONE, counts: true };
        self.fill(before, [0; PORTS], Steps::NONE, 1, turn);
        let rest = interval_ticks - before;
        if count == 1 {
            self.edges(rest, 1, axes, added);
        } else {
            self.edges(rest, 1, axes, 0);
            self.edges(interval_ticks, count - 1, axes, added);
        }
    }

    /// Fills a slot: the event that was held back, and `steps_in_it` steps, the last of them (or the end of its pulse)
    /// left for `held`.
    #[inline]
    fn fill(&mut self, interval_ticks: u32, then: [u32; PORTS], steps: Steps, steps_in_it: u16, held: Held<PORTS>) {
        let gap = if M::EVENTS_A_STEP == 2 { interval_ticks - self.signals.pulse_ticks } else { interval_ticks };
        // A pulse is followed by its end first.
        let near = gap < NEAR_TICKS && (M::EVENTS_A_STEP == 1 || self.signals.pulse_ticks < NEAR_TICKS);
        let events = (u32::from(steps_in_it) * M::EVENTS_A_STEP) as u16 & MOST_EVENTS;
        self.number = self.number.wrapping_add(events) & MOST_EVENTS;
        let Held { words: first, steps: first_steps, .. } = core::mem::replace(&mut self.held, held);
        let account = SlotAccount { first: first_steps, then: steps, events };
        self.accounts[self.filled as usize & (N - 1)] = account;
        let filling = Filling { first, then, reload: gap - 1, events, near, number: self.number };
        self.player.slot_of(self.filled).fill(&filling);
        self.filled = self.filled.wrapping_add(1);
    }
}
