//! Entries to slots: the producer's side of the queue.

use core::marker::PhantomData;

use ferrostep_planner::{StepEntry, StepKind};

use super::account::{DroppedSteps, SlotAccount, Steps};
use super::newest::{Following, Held, Newest, Usual, UsualSteps};
use super::pins::PinMap;
use super::player::{NEAR_TICKS, StepPlayer, Stepping};
use super::slot::{Head, MOST_EVENTS, Numbering};
use super::{IDLE_TICKS, StepLink};

/// Most slots that one entry takes, unless it has more events than a slot: a direction change, the first step after it,
/// the others.
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

/// Turns step entries into slots of a [`StepPlayer`].
///
/// The newest event is held back until the next entry tells the interval behind it. [`Self::seal`] lets it go at the end
/// of a motion.
#[derive(Debug)]
pub struct StepFeeder<'a, M, const PORTS: usize, const N: usize> {
    player: &'a StepPlayer<M, PORTS, N>,
    pins: PinMap<PORTS>,
    signals: Signals,
    /// Stairs with intervals above this, and no others, are usual: [`Usual`].
    usual_above_ticks: u32,
    newest: Newest<PORTS>,
    /// Direction signals at the newest event.
    directions: u8,
    /// Account of a slot with one step in these directions, which motor's is left open.
    step_account: SlotAccount,
    /// Direction signals from the next step on.
    turning: Option<u8>,
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
        let mut feeder = Self {
            player,
            pins,
            signals,
            usual_above_ticks: 0,
            newest: Newest {
                filled: player.next_number(),
                numbering: Numbering::new(M::EVENTS_A_STEP),
                levels: 0,
                held: Held::NOTHING,
            },
            directions: 0,
            step_account: SlotAccount::NONE,
            turning: None,
            accounts,
        };
        feeder.set_directions(0);
        feeder.turn(None);
        feeder
    }

    /// The flags shared with the interrupt.
    pub fn link(&self) -> &StepLink {
        self.player.link()
    }

    /// Slots filled so far, modulo 2^32.
    pub fn queued(&self) -> u32 {
        self.newest.filled
    }

    /// Slots played so far to their last event, modulo 2^32.
    pub fn played(&self) -> u32 {
        // Read in this order, a slot that ends in between is counted once too often, never once too few.
        let in_play = u32::from(self.player.left() != Head::EMPTY);
        self.newest.filled.wrapping_sub(self.unplayed()).wrapping_sub(in_play)
    }

    /// Slots that have not been played, the one in play and the event held back included.
    pub fn waiting(&self) -> usize {
        self.newest.filled.wrapping_sub(self.played()) as usize + usize::from(self.newest.held.counts())
    }

    /// Slots that the interrupt has not begun.
    fn unplayed(&self) -> u32 {
        self.newest.filled.wrapping_sub(self.player.next_number())
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
        let mut newest = self.newest;
        let mut usual = self.usual();
        if usual.push(&mut newest, entry) {
            self.newest = newest;
            return Ok(());
        }
        self.push_unusual(entry)
    }

    /// Adds entries, at half the cost that they have one by one.
    ///
    /// # Errors
    /// As [`Self::push`]; the entries before the one that is meant were added.
    pub fn push_all(&mut self, mut entries: &[StepEntry]) -> Result<(), FeedError> {
        loop {
            // There is not less room meanwhile.
            let fitting = entries.get(..self.room()).unwrap_or(entries);
            let mut newest = self.newest;
            let mut usual = self.usual();
            let mut left = fitting.iter();
            loop {
                usual.push_steps(&mut newest, &mut left);
                match left.as_slice().first() {
                    Some(entry) if usual.push(&mut newest, *entry) => left.next(),
                    _ => break,
                };
            }
            self.newest = newest;
            let pushed = fitting.len() - left.as_slice().len();
            let Some((first, others)) = entries.get(pushed..).and_then(<[StepEntry]>::split_first) else {
                return Ok(());
            };
            self.push_one(*first)?;
            entries = others;
        }
    }

    /// [`Self::push`], for those who have no use for a copy of it.
    #[inline(never)]
    fn push_one(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        self.push(entry)
    }

    /// The ways of a usual stair, as they are now.
    #[inline(always)]
    fn usual(&mut self) -> Usual<'_, M, PORTS, N> {
        Usual {
            player: self.player,
            accounts: self.accounts,
            above_ticks: self.usual_above_ticks,
            steps: UsualSteps {
                pins: &self.pins,
                pulse_ticks: self.signals.pulse_ticks,
                directions: self.directions,
                account: self.step_account,
                stepping: PhantomData,
            },
        }
    }

    /// Adds any entry; there is room for [`MOST_SLOTS_AN_ENTRY`].
    #[cold]
    #[inline(never)]
    fn push_unusual(&mut self, entry: StepEntry) -> Result<(), FeedError> {
        match entry.kind() {
            StepKind::Directions { directions } => self.turn((directions != self.directions).then_some(directions)),
            StepKind::Wait { interval_ticks } => {
                if interval_ticks < self.shortest_interval() {
                    return Err(FeedError::TooNear);
                }
                // In pulses an event without steps begins and ends nothing.
                self.fill(interval_ticks, [0; PORTS], Steps::NONE, 1, Held::NOTHING);
            }
            StepKind::Stair { interval_ticks, count, axes, added } => {
                if interval_ticks < self.shortest_interval() {
                    return Err(FeedError::TooNear);
                }
                // No stair of the planner's is so long that this is more.
                let slots =
                    usize::from(count) / (MOST_EVENTS as usize / M::EVENTS_A_STEP as usize) + MOST_SLOTS_AN_ENTRY;
                if self.unplayed() as usize + slots > N {
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

    /// From the next step on the direction signals are these; as they are now where there are none.
    fn turn(&mut self, directions: Option<u8>) {
        self.turning = directions;
        self.usual_above_ticks = match directions {
            Some(_) => u32::MAX,
            None => {
                let lead = if M::EVENTS_A_STEP == 2 { self.signals.pulse_ticks } else { 0 };
                let far_from = if self.can_be_near() { lead.saturating_add(NEAR_TICKS) } else { 0 };
                self.shortest_interval().max(far_from) - 1
            }
        };
    }

    fn set_directions(&mut self, directions: u8) {
        self.directions = directions;
        self.step_account = SlotAccount::new(Steps::NONE, Steps::new(0, directions), M::EVENTS_A_STEP);
    }

    /// Whether events may be so near that the interrupt stays for them: a pulse is followed by its end first.
    fn can_be_near(&self) -> bool {
        M::EVENTS_A_STEP == 1 || self.signals.pulse_ticks < NEAR_TICKS
    }

    /// The motion ends with the newest entry: what was held back may be played.
    pub fn seal(&mut self) {
        if self.newest.held.counts() {
            self.fill(IDLE_TICKS, [0; PORTS], Steps::NONE, 1, Held::NOTHING);
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
        let first = self.newest.filled.wrapping_sub(self.unplayed());
        let left = self.player.left().events();
        if left > 0 {
            self.drop_events(self.account(first.wrapping_sub(1)), left, &mut dropped);
        }
        for number in 0..self.unplayed() {
            let account = self.account(first.wrapping_add(number));
            self.drop_events(account, account.events(), &mut dropped);
        }
        if M::EVENTS_A_STEP == 1 {
            dropped.add(self.newest.held.steps, 1);
            self.newest.levels ^= self.newest.held.steps.axes();
        }
        self.player.forget(self.newest.filled);
        self.set_directions(self.turning.unwrap_or(self.directions));
        self.turn(None);
        self.newest.held = Held::NOTHING;
        dropped
    }

    /// The words that put the signals where this side believes them to be after [`Self::drop_all`].
    pub fn rest_words(&self) -> [u32; PORTS] {
        let low = if M::EVENTS_A_STEP == 2 { 0b1111 } else { 0 };
        let mut words = self.pins.raised(low).map(PinMap::<PORTS>::turned);
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
        let (first, then, all) = (account.first(), account.then(), account.events());
        if M::EVENTS_A_STEP == 2 {
            // Every second event, the last one included, is the start of a pulse; the first ends one that has stepped.
            dropped.add(then, events.div_ceil(2));
            return;
        }
        let first_too = events == all;
        let others = if first_too { events.saturating_sub(1) } else { events };
        dropped.add(then, others);
        self.newest.levels ^= if others & 1 == 1 { then.axes() } else { 0 };
        if first_too {
            dropped.add(first, 1);
            self.newest.levels ^= first.axes();
        }
    }

    fn shortest_interval(&self) -> u32 {
        let Signals { pulse_ticks, direction_setup_ticks } = self.signals;
        let levels = pulse_ticks.saturating_mul(M::EVENTS_A_STEP);
        if self.turning.is_none() {
            return levels;
        }
        // With pulses the direction changes at the end of the pulse before.
        let before = if M::EVENTS_A_STEP == 2 { pulse_ticks } else { 2 };
        levels.max(before + direction_setup_ticks.max(2))
    }

    /// A stair of any kind in the present directions.
    fn stair(&mut self, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        if M::EVENTS_A_STEP == 1 {
            self.edges(interval_ticks, count, axes, added);
            return;
        }
        if added == 0 {
            self.pulses(interval_ticks, count, axes);
            return;
        }
        // The last pulse is another one.
        if count > 1 {
            self.pulses(interval_ticks, count - 1, axes);
        }
        self.pulses(interval_ticks, 1, axes ^ added);
    }

    /// Both edges: `count` events, of which the last is held back.
    fn edges(&mut self, interval_ticks: u32, mut count: u16, axes: u8, added: u8) {
        while count > MOST_EVENTS {
            self.edges_in_a_slot(interval_ticks, MOST_EVENTS, axes, 0);
            count -= MOST_EVENTS;
        }
        self.edges_in_a_slot(interval_ticks, count, axes, added);
    }

    fn edges_in_a_slot(&mut self, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        let then = self.pins.toggled(axes, self.newest.levels);
        let before_last = self.newest.levels ^ if count & 1 == 0 { axes } else { 0 };
        let all = axes ^ added;
        self.newest.levels = before_last ^ all;
        let words = self.pins.toggled(all, before_last);
        let held = Held { words, steps: Steps::new(all, self.directions) };
        self.fill(interval_ticks, then, Steps::new(axes, self.directions), count, held);
    }

    /// `count` pulses, of which the last one's end is held back.
    fn pulses(&mut self, interval_ticks: u32, mut count: u16, axes: u8) {
        let steps = Steps::new(axes, self.directions);
        let rise = self.pins.raised(axes);
        let held = Held { words: rise.map(PinMap::<PORTS>::turned), steps: Steps::NONE };
        while count > MOST_EVENTS / 2 {
            self.fill(interval_ticks, rise, steps, MOST_EVENTS / 2, held);
            count -= MOST_EVENTS / 2;
        }
        self.fill(interval_ticks, rise, steps, count, held);
    }

    /// The first stair in a new direction.
    fn turn_and_stair(&mut self, directions: u8, interval_ticks: u32, count: u16, axes: u8, added: u8) {
        self.set_directions(directions);
        let words = self.pins.directions(directions);
        if M::EVENTS_A_STEP == 2 {
            // The signals change with the end of the pulse before.
            for (word, direction) in self.newest.held.words.iter_mut().zip(words) {
                *word |= direction;
            }
            self.stair(interval_ticks, count, axes, added);
            return;
        }
        // Half way, or as late as the set-up time allows: an event of its own.
        let before = (interval_ticks / 2).min(interval_ticks - self.signals.direction_setup_ticks.max(2)).max(2);
        let turn = Held { words, steps: Steps::NONE };
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
    fn fill(&mut self, interval_ticks: u32, then: [u32; PORTS], steps: Steps, steps_in_it: u16, held: Held<PORTS>) {
        let lead = if M::EVENTS_A_STEP == 2 { self.signals.pulse_ticks } else { 0 };
        let gap_ticks = interval_ticks - lead;
        let near = gap_ticks < NEAR_TICKS && self.can_be_near();
        let events = u32::from(steps_in_it) * M::EVENTS_A_STEP;
        self.newest.fill(self.player, self.accounts, near, Following { gap_ticks, then, steps, events, held });
    }
}
