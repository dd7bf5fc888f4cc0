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
    fn add(&mut self, axes: u8, directions: u8, count: u32) {
        for (motor, (signed, issued)) in self.signed.iter_mut().zip(&mut self.issued).enumerate() {
            if axes >> motor & 1 != 0 {
                *issued = issued.wrapping_add(count);
                let count = count as i32;
                *signed = signed.wrapping_add(if directions >> motor & 1 != 0 { count.wrapping_neg() } else { count });
            }
        }
    }
}

/// What a slot's events step, for the accounts after a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotSteps {
    axes: u8,
    /// Motors that step in the last event only.
    added: u8,
    directions: u8,
}

impl SlotSteps {
    /// No motor, all forwards.
    pub const NONE: Self = Self { axes: 0, added: 0, directions: 0 };
}

/// A slot that waits for the interval of the one behind it.
#[derive(Clone, Copy, Debug)]
struct Pending<const PORTS: usize> {
    first: [u32; PORTS],
    last: [u32; PORTS],
    events: u16,
    near: bool,
    steps: SlotSteps,
}

/// Turns step entries into slots of a [`StepPlayer`].
///
/// The newest slot is held back until the next entry tells its interval. [`Self::seal`] lets it go at the end of a motion.
#[derive(Debug)]
pub struct StepFeeder<'a, M, const PORTS: usize, const N: usize> {
    player: &'a StepPlayer<M, PORTS, N>,
    pins: PinMap<PORTS>,
    signals: Signals,
    /// Slots filled so far, modulo 2^32.
    filled: u32,
    /// Events in them, modulo 2^15.
    number: u16,
    /// Both edges: the level of each step signal after the newest event.
    levels: u8,
    /// Direction signals at the newest event.
    directions: u8,
    /// Direction signals from the next step on.
    turning: Option<u8>,
    pending: Pending<PORTS>,
    steps: &'a mut [SlotSteps; N],
}

impl<'a, M: Stepping, const PORTS: usize, const N: usize> StepFeeder<'a, M, PORTS, N> {
    /// The feeder of a player that has not run yet; there must be no other. All signals are low. `steps` is memory for
    /// its accounts.
    pub fn new(
        player: &'a StepPlayer<M, PORTS, N>,
        pins: PinMap<PORTS>,
        signals: Signals,
        steps: &'a mut [SlotSteps; N],
    ) -> Self {
        player.set_pulse_reload(signals.pulse_ticks.max(2) - 1);
        Self {
            player,
            pins,
            signals,
            filled: player.played(),
            number: 0,
            levels: 0,
            directions: 0,
            turning: None,
            pending: Self::nothing(0),
            steps,
        }
    }

    /// The flags shared with the interrupt.
    pub fn link(&self) -> &StepLink {
        self.player.link()
    }

    /// Updates that the interrupt missed and made up.
    pub fn made_up_updates(&self) -> u32 {
        self.player.made_up_updates()
    }

    /// Slots filled so far and the one held back, modulo 2^32.
    pub fn queued(&self) -> u32 {
        self.filled.wrapping_add(u32::from(self.pending.steps.axes != 0))
    }

    /// Slots played so far, modulo 2^32.
    pub fn played(&self) -> u32 {
        self.player.played()
    }

    /// Slots that have not been played, the one that is being played and the one held back included.
    pub fn waiting(&self) -> usize {
        self.queued().wrapping_sub(self.played()) as usize
    }

    /// How many entries fit at least.
    pub fn room(&self) -> usize {
        let used = self.filled.wrapping_sub(self.player.played()) as usize;
        N.saturating_sub(used) / MOST_SLOTS_AN_ENTRY
    }

    /// Adds an entry.
    ///
    /// # Errors
    /// The ring is full, or the entry is nearer to the one before than the drivers allow; nothing was added.
    #[inline]
    pub fn push(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        if self.room() == 0 {
            return Err(FeedError::Full);
        }
        match entry.kind() {
            StepKind::Directions { directions } => self.turning = (directions != self.directions).then_some(directions),
            StepKind::Wait { interval_ticks } => self.pass(interval_ticks)?,
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
        if self.pending.steps.axes != 0 {
            let nothing = Self::nothing(self.directions);
            self.hold(IDLE_TICKS, nothing);
        }
    }

    /// While the interrupt is masked, because somebody has stopped motion: forgets what has not been played.
    ///
    /// Afterwards [`Self::rest_words`] belong on the ports, and the interrupt may run again.
    pub fn drop_all(&mut self) -> DroppedSteps {
        let mut dropped = DroppedSteps::default();
        let mut left = self.player.events_left();
        let mut number = self.player.played();
        while number != self.filled {
            if left == 0 {
                left = match self.player.slot_of(number).head() {
                    Head::Empty => 0,
                    Head::Far { but_one } | Head::Near { but_one } => but_one.unsigned_abs() + 1,
                };
            }
            let steps = self.steps[number as usize & (N - 1)];
            self.drop_events(steps, left, &mut dropped);
            left = 0;
            number = number.wrapping_add(1);
        }
        self.drop_events(self.pending.steps, u32::from(self.pending.events), &mut dropped);
        self.player.forget(self.filled);
        self.directions = self.turning.take().unwrap_or(self.directions);
        self.pending = Self::nothing(self.directions);
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

    /// A step whose rising edge is out has been made, whatever becomes of its end.
    fn drop_events(&mut self, steps: SlotSteps, events: u32, dropped: &mut DroppedSteps) {
        let count = events / M::EVENTS_A_STEP;
        if count == 0 {
            return;
        }
        dropped.add(steps.axes, steps.directions, count);
        dropped.add(steps.added & !steps.axes, steps.directions, 1);
        if M::EVENTS_A_STEP == 1 {
            self.levels ^= if count & 1 == 1 { steps.axes } else { 0 } ^ (steps.added & !steps.axes);
        }
    }

    fn shortest_interval(&self) -> u32 {
        let Signals { pulse_ticks, direction_setup_ticks } = self.signals;
        let levels = (pulse_ticks * M::EVENTS_A_STEP).max(2 * M::EVENTS_A_STEP);
        if self.turning.is_none() {
            return levels;
        }
        // With pulses the direction changes at the end of the pulse before.
        let before = if M::EVENTS_A_STEP == 2 { pulse_ticks.max(2) } else { 2 };
        levels.max(before + direction_setup_ticks.max(2))
    }

    /// An event without steps.
    fn nothing(directions: u8) -> Pending<PORTS> {
        Pending {
            first: [0; PORTS],
            last: [0; PORTS],
            events: M::EVENTS_A_STEP as u16,
            near: false,
            steps: SlotSteps { axes: 0, added: 0, directions },
        }
    }

    fn pass(&mut self, interval_ticks: u32) -> Result<(), FeedError> {
        if interval_ticks < 2 * M::EVENTS_A_STEP {
            return Err(FeedError::TooNear);
        }
        let nothing = Self::nothing(self.directions);
        self.hold(interval_ticks, nothing);
        Ok(())
    }

    #[inline]
    fn stair(&mut self, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        if M::EVENTS_A_STEP == 2 && count > 1 && added & !axes != 0 {
            // The pulse of the last step is another one.
            self.plain_stair(interval_ticks, count - 1, axes, 0);
            self.plain_stair(interval_ticks, 1, axes | added, 0);
        } else if M::EVENTS_A_STEP == 2 && u32::from(count) * M::EVENTS_A_STEP > u32::from(MOST_EVENTS) {
            self.plain_stair(interval_ticks, count / 2, axes, 0);
            self.plain_stair(interval_ticks, count - count / 2, axes, added);
        } else {
            self.plain_stair(interval_ticks, count, axes, added);
        }
    }

    #[inline]
    fn plain_stair(&mut self, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        let steps = SlotSteps { axes, added, directions: self.directions };
        let (first, last);
        if M::EVENTS_A_STEP == 1 {
            first = self.pins.steps(axes & !self.levels, axes & self.levels);
            let before_last = self.levels ^ if count & 1 == 0 { axes } else { 0 };
            let all = axes | added;
            last = self.pins.steps(all & !before_last, all & before_last);
            self.levels = before_last ^ all;
        } else {
            first = self.pins.steps(axes | added, 0);
            last = self.pins.steps(0, axes | added);
        }
        let gap = if M::STAYS_FOR_PULSE { interval_ticks - self.signals.pulse_ticks } else { interval_ticks };
        let near = gap < NEAR_TICKS && (M::EVENTS_A_STEP == 1 || M::STAYS_FOR_PULSE);
        let events = (u32::from(count) * M::EVENTS_A_STEP) as u16;
        self.hold(interval_ticks, Pending { first, last, events, near, steps });
    }

    /// The first stair in a new direction.
    fn turn_and_stair(&mut self, directions: u8, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        self.directions = directions;
        let words = self.pins.directions(directions);
        if M::EVENTS_A_STEP == 2 {
            // The signals change with the end of the pulse before.
            for (word, direction) in self.pending.last.iter_mut().zip(words) {
                *word |= direction;
            }
            self.stair(interval_ticks, count, axes, added);
            return;
        }
        // Half way, or as late as the set-up time allows: an event of its own.
        let before = (interval_ticks / 2).min(interval_ticks - self.signals.direction_setup_ticks.max(2)).max(2);
        let turn = Pending { first: words, last: words, ..Self::nothing(directions) };
        self.hold(before, turn);
        let rest = interval_ticks - before;
        if count == 1 {
            self.plain_stair(rest, 1, axes, added);
        } else {
            self.plain_stair(rest, 1, axes, 0);
            self.plain_stair(interval_ticks, count - 1, axes, added);
        }
    }

    /// Fills a slot with what was held back, whose successor comes after `interval_ticks`, and holds the successor back.
    #[inline]
    fn hold(&mut self, interval_ticks: u32, next: Pending<PORTS>) {
        let pulse = if M::EVENTS_A_STEP == 2 { self.signals.pulse_ticks.max(2) } else { 0 };
        let Pending { first, last, events, near, steps } = core::mem::replace(&mut self.pending, next);
        self.number = self.number.wrapping_add(events) & MOST_EVENTS;
        let next_reload = interval_ticks.saturating_sub(pulse).max(2) - 1;
        self.steps[self.filled as usize & (N - 1)] = steps;
        let slot = self.player.slot_of(self.filled);
        slot.fill(&Filling { first, last, next_reload, events, near, number: self.number });
        self.filled = self.filled.wrapping_add(1);
    }
}
