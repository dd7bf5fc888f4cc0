//! The newest event, held back, and the slots that are filled when its successor comes.

use core::hint::cold_path;
use core::marker::PhantomData;
use core::slice::Iter;

use ferrostep_planner::StepEntry;

use super::account::{SlotAccount, Steps};
use super::pins::PinMap;
use super::player::{StepPlayer, Stepping};
use super::slot::{Filling, MOST_EVENTS, Numbering, Slot};

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
    /// Events in them.
    pub(super) numbering: Numbering,
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
    pub(super) accounts: &'a mut [SlotAccount; N],
    /// Intervals above this are usual.
    pub(super) above_ticks: u32,
    pub(super) steps: UsualSteps<'a, M, PORTS>,
}

/// How they step.
pub(super) struct UsualSteps<'a, M, const PORTS: usize> {
    pub(super) pins: &'a PinMap<PORTS>,
    /// How long a pulse is.
    pub(super) pulse_ticks: u32,
    pub(super) directions: u8,
    /// Of a slot with one step, which motor's is left open.
    pub(super) account: SlotAccount,
    pub(super) stepping: PhantomData<M>,
}

impl<M: Stepping, const PORTS: usize, const N: usize> Usual<'_, M, PORTS, N> {
    /// Adds entries of a single event each, as most are, as long as they are as [`Self::push`] wants them. There must be
    /// room for them.
    #[inline(always)]
    pub(super) fn push_steps(&mut self, newest: &mut Newest<PORTS>, entries: &mut Iter<'_, StepEntry>) {
        while let Some(entry) = entries.as_slice().first()
            && entry.interval_ticks() > self.above_ticks
            && entry.is_single()
        {
            let account = &mut self.accounts[newest.filled as usize & (N - 1)];
            let slot = self.player.slot_of(newest.filled);
            self.steps.step(newest, slot, account, entry.interval_ticks(), entry.axes());
            newest.filled = newest.filled.wrapping_add(1);
            entries.next();
        }
    }

    /// Adds an entry if it is a stair as most are: it goes on in the same directions, and its events are neither too near
    /// nor so near that the interrupt stays for them. Whether it was one; if not, nothing has changed. For one entry there
    /// must be room.
    #[inline(always)]
    pub(super) fn push(&mut self, newest: &mut Newest<PORTS>, entry: StepEntry) -> bool {
        cold_path();
        let (interval_ticks, count) = (entry.interval_ticks(), u32::from(entry.count()));
        let most = u32::from(MOST_EVENTS) / M::EVENTS_A_STEP;
        if interval_ticks <= self.above_ticks || count.wrapping_sub(1) >= most {
            return false;
        }
        let (axes, added) = (entry.axes() & 15, entry.added() & 15);
        let has_other = added != 0;
        if M::EVENTS_A_STEP == 1 {
            let following = self.steps.edges(newest, interval_ticks, count, axes, added);
            newest.fill(self.player, self.accounts, false, following);
            return true;
        }
        // The last of pulses may be another one.
        let alike = count - u32::from(has_other);
        if alike > 0 {
            let following = self.steps.pulses(interval_ticks, alike, axes);
            newest.fill(self.player, self.accounts, false, following);
        }
        if has_other {
            let account = &mut self.accounts[newest.filled as usize & (N - 1)];
            self.steps.step(newest, self.player.slot_of(newest.filled), account, interval_ticks, axes ^ added);
            newest.filled = newest.filled.wrapping_add(1);
        }
        true
    }
}

impl<M: Stepping, const PORTS: usize> UsualSteps<'_, M, PORTS> {
    /// Fills a slot with an event of its own, as most are: all of it is known in advance but the motors.
    #[inline(always)]
    fn step(
        &self,
        newest: &mut Newest<PORTS>,
        slot: &Slot<PORTS>,
        account: &mut SlotAccount,
        interval_ticks: u32,
        axes: u8,
    ) {
        let first = newest.held.words;
        let (then, gap_ticks);
        if M::EVENTS_A_STEP == 1 {
            *account = self.account.with_axes(axes).with_first(newest.held.steps);
            (then, gap_ticks) = (self.pins.toggled(axes, newest.levels), interval_ticks);
            newest.levels ^= axes;
            newest.held = Held { words: then, steps: Steps::new(axes, self.directions) };
        } else {
            *account = self.account.with_axes(axes);
            (then, gap_ticks) = (self.pins.raised(axes), interval_ticks.wrapping_sub(self.pulse_ticks));
            // The end of a pulse steps nothing, as the one before.
            newest.held.words = then.map(PinMap::<PORTS>::turned);
        }
        newest.numbering.advance(M::EVENTS_A_STEP);
        slot.fill(&Filling { first, then, reload: gap_ticks.wrapping_sub(1), head: newest.numbering.head_of_step() });
    }

    /// Both edges: `count` events, of which the last is held back.
    #[inline(always)]
    fn edges(&self, newest: &mut Newest<PORTS>, gap_ticks: u32, count: u32, axes: u8, added: u8) -> Following<PORTS> {
        let then = self.pins.toggled(axes, newest.levels);
        newest.levels ^= if count & 1 == 0 { axes } else { 0 };
        let all = axes ^ added;
        let held = Held { words: self.pins.toggled(all, newest.levels), steps: Steps::new(all, self.directions) };
        newest.levels ^= all;
        Following { gap_ticks, then, steps: Steps::new(axes, self.directions), events: count, held }
    }

    /// `count` pulses, of which the last one's end is held back.
    #[inline(always)]
    fn pulses(&self, interval_ticks: u32, count: u32, axes: u8) -> Following<PORTS> {
        let then = self.pins.raised(axes);
        Following {
            gap_ticks: interval_ticks.wrapping_sub(self.pulse_ticks),
            then,
            steps: Steps::new(axes, self.directions),
            events: count * M::EVENTS_A_STEP,
            held: Held { words: then.map(PinMap::<PORTS>::turned), steps: Steps::NONE },
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
        // The end of a pulse steps nothing.
        let first_steps = if M::EVENTS_A_STEP == 2 { Steps::NONE } else { self.held.steps };
        accounts[self.filled as usize & (N - 1)] = SlotAccount::new(first_steps, steps, events);
        self.numbering.advance(events);
        let (first, reload) = (self.held.words, gap_ticks.wrapping_sub(1));
        let head = self.numbering.head(events, near);
        player.slot_of(self.filled).fill(&Filling { first, then, reload, head });
        self.filled = self.filled.wrapping_add(1);
        self.held.words = held.words;
        if M::EVENTS_A_STEP == 1 {
            self.held.steps = held.steps;
        }
    }
}
