//! The newest event, held back, and the slots that are filled when its successor comes.

use ferrostep_planner::StepEntry;

use super::account::{SlotAccount, Steps};
use super::pins::PinMap;
use super::player::{StepPlayer, Stepping};
use super::slot::{Filling, MOST_EVENTS};

/// An event that waits for the interval behind it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held<const PORTS: usize> {
    /// Zeros where there is nothing to be seen of it on the pins.
    pub(super) words: [u32; PORTS],
    /// What it steps; of a pulse's end nothing, its start has stepped.
    pub(super) steps: Steps,
}

impl<const PORTS: usize> Held<PORTS> {
    /// An event without steps.
    pub(super) const NOTHING: Self = Self { words: [0; PORTS], steps: Steps::NONE };

    /// Whether there is anything to be seen of it.
    pub(super) fn counts(&self) -> bool {
        self.words != [0; PORTS]
    }
}

/// What every slot changes. Small enough to be kept in registers while many are filled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Newest<const PORTS: usize> {
    /// Slots filled so far, modulo 2^32; the place of the next is its remainder by the size of the ring.
    pub(super) filled: u32,
    /// Events in them, modulo 2^15.
    pub(super) number: u32,
    /// Both edges: the level of each step signal after the newest event.
    pub(super) levels: u8,
    /// The newest event.
    pub(super) held: Held<PORTS>,
}

/// Events that follow the one that was held back.
pub(super) struct Following<const PORTS: usize> {
    /// Ticks from each event of the slot to the next one, at least 1. Of pulses, the low part.
    pub(super) gap_ticks: u32,
    /// The words of the slot's second event.
    pub(super) then: [u32; PORTS],
    /// What the events behind the slot's first step.
    pub(super) steps: Steps,
    /// Events in the slot, 1 to [`MOST_EVENTS`].
    pub(super) events: u32,
    /// The last of those that follow, which the slot leaves to the next one.
    pub(super) held: Held<PORTS>,
}

/// What stays the same while stairs go on in the same directions.
pub(super) struct Usual<'a, M, const PORTS: usize, const N: usize> {
    pub(super) player: &'a StepPlayer<M, PORTS, N>,
    pub(super) pins: &'a PinMap<PORTS>,
    pub(super) accounts: &'a mut [SlotAccount; N],
    /// Intervals above this are usual.
    pub(super) above_ticks: u32,
    /// How long a pulse is.
    pub(super) pulse_ticks: u32,
    pub(super) directions: u8,
}

impl<M: Stepping, const PORTS: usize, const N: usize> Usual<'_, M, PORTS, N> {
    /// Adds an entry if it is a stair as most are: it goes on in the same directions, and its events are neither too near
    /// nor so near that the interrupt stays for them. Whether it was one; if not, nothing has changed. For one entry there
    /// must be room.
    #[inline(always)]
    pub(super) fn push(&mut self, newest: &mut Newest<PORTS>, entry: StepEntry) -> bool {
        let (interval_ticks, count) = (entry.interval_ticks(), u32::from(entry.count()));
        let most = u32::from(MOST_EVENTS) / M::EVENTS_A_STEP;
        if interval_ticks <= self.above_ticks || count.wrapping_sub(1) >= most {
            return false;
        }
        let (axes, added) = (entry.axes() & 15, entry.added());
        if M::EVENTS_A_STEP == 1 {
            self.edges(newest, interval_ticks, count, axes, added);
        } else {
            self.pulses(newest, interval_ticks, count, axes, added);
        }
        true
    }

    /// The same for an entry of a single event, which most are.
    #[inline(always)]
    pub(super) fn push_single(&mut self, newest: &mut Newest<PORTS>, entry: StepEntry) -> bool {
        if entry.interval_ticks() <= self.above_ticks || !entry.is_single() {
            return false;
        }
        let axes = entry.axes() & 15;
        let steps = Steps::new(axes, self.directions);
        let (gap_ticks, then, held) = if M::EVENTS_A_STEP == 1 {
            let words = self.pins.toggled(axes, newest.levels);
            newest.levels ^= axes;
            (entry.interval_ticks(), words, Held { words, steps })
        } else {
            let words = self.pins.raised(axes);
            let held = Held { words: words.map(PinMap::<PORTS>::turned), steps: Steps::NONE };
            (entry.interval_ticks().wrapping_sub(self.pulse_ticks), words, held)
        };
        let following = Following { gap_ticks, then, steps, events: M::EVENTS_A_STEP, held };
        newest.fill(self.player, self.accounts, false, following);
        true
    }

    /// Both edges: `count` events, of which the last is held back.
    #[inline(always)]
    fn edges(&mut self, newest: &mut Newest<PORTS>, gap_ticks: u32, count: u32, axes: u8, added: u8) {
        let steps = Steps::new(axes, self.directions);
        let then = self.pins.toggled(axes, newest.levels);
        let mut held = Held { words: then, steps };
        if count | u32::from(added) << 16 == 1 {
            newest.levels ^= axes;
        } else {
            newest.levels ^= if count & 1 == 0 { axes } else { 0 };
            let all = axes ^ added;
            held = Held { words: self.pins.toggled(all, newest.levels), steps: Steps::new(all, self.directions) };
            newest.levels ^= all;
        }
        newest.fill(self.player, self.accounts, false, Following { gap_ticks, then, steps, events: count, held });
    }

    /// `count` pulses, of which the last one's end is held back; that one may be another.
    #[inline(always)]
    fn pulses(&mut self, newest: &mut Newest<PORTS>, interval_ticks: u32, count: u32, axes: u8, added: u8) {
        let gap_ticks = interval_ticks.wrapping_sub(self.pulse_ticks);
        let (mut axes, mut count, mut last) = (axes, count, 0);
        let added = added & 15;
        if added != 0 {
            last = axes ^ added;
            count -= 1;
            if count == 0 {
                (axes, count, last) = (last, 1, 0);
            }
        }
        // One copy of this code.
        loop {
            let steps = Steps::new(axes, self.directions);
            let then = self.pins.raised(axes);
            let held = Held { words: then.map(PinMap::<PORTS>::turned), steps: Steps::NONE };
            let following = Following { gap_ticks, then, steps, events: count * M::EVENTS_A_STEP, held };
            newest.fill(self.player, self.accounts, false, following);
            if last == 0 {
                return;
            }
            (axes, count, last) = (last, 1, 0);
        }
    }
}

impl<const PORTS: usize> Newest<PORTS> {
    /// Fills a slot: the event that was held back, and all that follow but the last.
    #[inline(always)]
    pub(super) fn fill<M: Stepping, const N: usize>(
        &mut self,
        player: &StepPlayer<M, PORTS, N>,
        accounts: &mut [SlotAccount; N],
        near: bool,
        following: Following<PORTS>,
    ) {
        let Following { gap_ticks, then, steps, events, held } = following;
        self.number = self.number.wrapping_add(events) & u32::from(MOST_EVENTS);
        // The end of a pulse steps nothing.
        let first_steps = if M::EVENTS_A_STEP == 2 { Steps::NONE } else { self.held.steps };
        accounts[self.filled as usize & (N - 1)] = SlotAccount::new(first_steps, steps, events);
        let (first, reload) = (self.held.words, gap_ticks.wrapping_sub(1));
        player.slot_of(self.filled).fill(&Filling { first, then, reload, events, near, number: self.number });
        self.filled = self.filled.wrapping_add(1);
        self.held = held;
    }
}
