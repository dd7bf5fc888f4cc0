//! What the step interrupt does.

use core::marker::PhantomData;

use super::StepLink;
use super::slot::{Head, MOST_EVENTS, Slot};
use super::word::{WordI32, WordU32};

/// Events nearer than this (at 84 MHz: 0.36 us, 60 cycles) are played without leaving the interrupt: leaving and
/// entering take 22 cycles, and what is done around an event about as many.
pub const NEAR_TICKS: u32 = 30;

/// Most events that the interrupt stays for, one after another: then it leaves at least once, after at most this many
/// times [`NEAR_TICKS`] = 11 us.
pub const MOST_STAYED_EVENTS: u32 = 32;

/// Most looks at the timer while the interrupt stays for an event: several times [`NEAR_TICKS`].
const MOST_LOOKS: u32 = 64;

/// Events that were missed are made up at most this many at a time.
const MOST_MADE_UP: u16 = 64;

/// The step timer, seen from its interrupt. No method may wait.
pub trait UpdateTimer {
    /// Takes note of the update.
    fn clear_update(&self);
    /// Whether there was an update since.
    fn is_update_due(&self) -> bool;
    /// From the update after the next one on, an update every `reload` + 1 ticks.
    fn set_reload(&self, reload: u32);
    /// Ticks since the last update.
    fn counter(&self) -> u32;
    /// The number of updates that there have been, modulo 2^15, counted by the hardware; always 0 where it cannot.
    fn update_count(&self) -> u16;
    /// Says what that number is now.
    fn set_update_count(&self, count: u16);
    /// After staying in the interrupt: updates that were served in it do not call it again.
    fn forget_served(&self);
}

/// A port of pins.
pub trait OutputPort {
    /// The lower half's ones set pins, the upper half's reset them, at once; zeros do nothing.
    fn write(&self, word: u32);
}

/// How step signals step.
pub trait Stepping {
    /// Events that a step takes: one, or one for each edge of its pulse.
    const EVENTS_A_STEP: u32;
    /// Whether the pulse is so short that the interrupt stays for its end.
    const STAYS_FOR_PULSE: bool;
}

/// Each edge of the signal is a step (TMC drivers, `dedge`).
#[derive(Clone, Copy, Debug)]
pub struct BothEdges;
/// The rising edge is a step; the pulse ends in an event of its own, so that nobody waits for it.
#[derive(Clone, Copy, Debug)]
pub struct Pulses;
/// The same with pulses shorter than [`NEAR_TICKS`].
#[derive(Clone, Copy, Debug)]
pub struct ShortPulses;

impl Stepping for BothEdges {
    const EVENTS_A_STEP: u32 = 1;
    const STAYS_FOR_PULSE: bool = false;
}

impl Stepping for Pulses {
    const EVENTS_A_STEP: u32 = 2;
    const STAYS_FOR_PULSE: bool = false;
}

impl Stepping for ShortPulses {
    const EVENTS_A_STEP: u32 = 2;
    const STAYS_FOR_PULSE: bool = true;
}

/// What has just happened.
#[derive(Clone, Copy, PartialEq, Eq)]
enum After {
    /// An event that is not the last of its slot.
    Within,
    /// The same, and the end of its pulse is near.
    InPulse,
    /// The last event of a slot; the next event is far, or nobody knows of one.
    Far,
    /// The last event of a slot; the next slot's events are near.
    Near,
}

/// Waits for an event that is near; whether it came.
#[inline(always)]
fn is_due_soon<T: UpdateTimer>(timer: &T) -> bool {
    (0..MOST_LOOKS).any(|_| timer.is_update_due())
}

/// No slot is being played.
const DRY: i32 = -1;

/// The ring of `N` slots, `N` a power of two, and the state of the interrupt that plays them.
///
/// There is one producer, [`super::StepFeeder`], and one interrupt that calls [`Self::update`]. Everything is a word that
/// either may load and store whole, so that no access is unsafe.
#[derive(Debug)]
pub struct StepPlayer<M, const PORTS: usize, const N: usize> {
    /// Events of the present slot that are still to come, less one; [`DRY`] when there is no slot.
    left: WordI32,
    /// The words of the next event.
    words: [WordU32; PORTS],
    /// Slots played so far, modulo 2^32: where the present one is.
    played: WordU32,
    /// The reload values of the gap behind a pulse (for pulses), and of the shortest pulse.
    reloads: [WordU32; 2],
    /// Updates that were missed and made up.
    made_up: WordU32,
    link: StepLink,
    pub(super) slots: [Slot<PORTS>; N],
    stepping: PhantomData<M>,
}

/// Marks a count of events of a slot of near events that the interrupt has left before its end.
const LEFT: i32 = i32::MIN;

impl<M: Stepping, const PORTS: usize, const N: usize> Default for StepPlayer<M, PORTS, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<M: Stepping, const PORTS: usize, const N: usize> StepPlayer<M, PORTS, N> {
    /// A player with an empty ring.
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two() && N >= 8 && N <= 1 << 15) };
        Self {
            left: WordI32::new(DRY),
            words: [const { WordU32::new(0) }; PORTS],
            played: WordU32::new(0),
            reloads: [WordU32::new(super::IDLE_TICKS), WordU32::new(super::IDLE_TICKS)],
            made_up: WordU32::new(0),
            link: StepLink::new(),
            slots: [const { Slot::EMPTY }; N],
            stepping: PhantomData,
        }
    }

    /// The flags.
    pub const fn link(&self) -> &StepLink {
        &self.link
    }

    /// Updates that the interrupt missed because it was held up for longer than an interval, and made up.
    pub fn made_up_updates(&self) -> u32 {
        self.made_up.load()
    }

    /// The interrupt: puts out the event that is due and prepares the next. No lock, no float, no division, no panic.
    ///
    /// The edges come first, at the same distance from the interrupt's entry whatever follows.
    #[inline(always)]
    pub fn update<T: UpdateTimer, P: OutputPort>(&self, timer: &T, ports: &[P; PORTS]) {
        timer.clear_update();
        match self.event::<true, T, P>(timer, ports) {
            After::Within | After::Far => {}
            After::InPulse => self.stay(false, timer, ports),
            After::Near => self.stay(true, timer, ports),
        }
    }

    /// `CHECKED`: looks for missed updates at the end of a slot.
    #[inline(always)]
    fn event<const CHECKED: bool, T: UpdateTimer, P: OutputPort>(&self, timer: &T, ports: &[P; PORTS]) -> After {
        let left = self.left.load().wrapping_sub(1);
        for (port, word) in ports.iter().zip(&self.words) {
            let now = word.load();
            port.write(now);
            if left > 0 {
                word.store(now.rotate_right(16));
            }
        }
        if left > 0 {
            self.left.store(left);
            return self.alternate(left, timer);
        }
        self.turn::<CHECKED, T, P>(left, timer, ports)
    }

    /// For pulses: at an event within a slot, the gap after the next one.
    #[inline(always)]
    fn alternate<T: UpdateTimer>(&self, left: i32, timer: &T) -> After {
        if M::EVENTS_A_STEP == 1 {
            return After::Within;
        }
        // An even number is left behind a rising edge.
        let rising = left & 1 == 0;
        timer.set_reload(self.reloads[usize::from(!rising)].load());
        if M::STAYS_FOR_PULSE && rising { After::InPulse } else { After::Within }
    }

    /// The end of a slot: its last event but one, its last, or none at all.
    #[inline(always)]
    fn turn<const CHECKED: bool, T: UpdateTimer, P: OutputPort>(
        &self,
        left: i32,
        timer: &T,
        ports: &[P; PORTS],
    ) -> After {
        let slot = self.slot();
        if left == 0 {
            self.left.store(0);
            self.prepare_last(slot, timer);
            return if M::STAYS_FOR_PULSE { After::InPulse } else { After::Within };
        }
        if left < DRY {
            return self.resume(left, slot, timer);
        }
        let number = slot.number();
        slot.clear();
        let played = self.played.load().wrapping_add(1);
        self.played.store(played);
        let after = self.load(self.at(played), timer);
        // Without a counter the hardware's number stays 0 and is never above.
        if CHECKED && timer.update_count() > number {
            return self.make_up(number, after, timer, ports);
        }
        after
    }

    /// One event of the slot is left: the gap behind it is the next slot's.
    #[inline(always)]
    fn prepare_last<T: UpdateTimer>(&self, slot: &Slot<PORTS>, timer: &T) {
        for (index, word) in self.words.iter().enumerate() {
            word.store(slot.last(index));
        }
        let reload = slot.next_reload();
        timer.set_reload(reload);
        if M::EVENTS_A_STEP == 2 {
            self.reloads[0].store(reload);
        }
    }

    /// Begins a slot, if there is one.
    #[inline(always)]
    fn load<T: UpdateTimer>(&self, slot: &Slot<PORTS>, timer: &T) -> After {
        match slot.head() {
            Head::Far { but_one } => {
                self.begin(slot, but_one, timer);
                After::Far
            }
            Head::Near { but_one } => {
                self.begin(slot, but_one, timer);
                After::Near
            }
            Head::Empty => {
                self.run_dry();
                After::Far
            }
        }
    }

    #[inline(always)]
    fn begin<T: UpdateTimer>(&self, slot: &Slot<PORTS>, but_one: i32, timer: &T) {
        self.left.store(but_one);
        if but_one == 0 && M::EVENTS_A_STEP == 1 {
            self.prepare_last(slot, timer);
            return;
        }
        for (index, word) in self.words.iter().enumerate() {
            word.store(slot.first(index));
        }
        if M::EVENTS_A_STEP == 2 {
            timer.set_reload(self.reloads[1].load());
        }
    }

    #[inline(always)]
    fn run_dry(&self) {
        self.left.store(DRY);
        for word in &self.words {
            word.store(0);
        }
        self.link.run_dry();
    }

    /// Without a slot, or in one of near events that the interrupt has left.
    #[inline(always)]
    fn resume<T: UpdateTimer>(&self, left: i32, slot: &Slot<PORTS>, timer: &T) -> After {
        if left == DRY - 1 {
            return self.look(slot, timer);
        }
        let left = left ^ LEFT;
        self.left.store(left);
        if left > 0 {
            for word in &self.words {
                word.store(word.load().rotate_right(16));
            }
        } else {
            self.prepare_last(slot, timer);
        }
        After::Near
    }

    /// Without a slot: looks for one. The reload value is that of the slot which should have been there, so that the
    /// first event of the one that comes is as far from this update as it should be.
    #[inline(always)]
    fn look<T: UpdateTimer>(&self, slot: &Slot<PORTS>, timer: &T) -> After {
        if !self.link.is_running() {
            return After::Far;
        }
        let after = self.load(slot, timer);
        // From here on the updates count, one that has come meanwhile included.
        let events = self.left.load().wrapping_add(1) as u16;
        let before = slot.number().wrapping_sub(events).wrapping_add(u16::from(timer.is_update_due()));
        timer.set_update_count(before & MOST_EVENTS);
        after
    }

    /// Plays events as long as they are near, up to a bound. `near`: the present slot's are.
    #[inline(always)]
    fn stay<T: UpdateTimer, P: OutputPort>(&self, mut near: bool, timer: &T, ports: &[P; PORTS]) {
        for _ in 0..MOST_STAYED_EVENTS {
            if !is_due_soon(timer) {
                break;
            }
            timer.clear_update();
            match self.event::<true, T, P>(timer, ports) {
                After::Near => near = true,
                After::InPulse => {}
                After::Within if near => {}
                After::Within | After::Far => {
                    near = false;
                    break;
                }
            }
        }
        // Left before its end, a slot with more than one event to come is taken up again by staying.
        let left = self.left.load();
        if near && M::EVENTS_A_STEP == 1 && left > 0 {
            self.left.store(left ^ LEFT);
        }
        timer.forget_served();
    }

    /// The hardware has counted more updates than were played up to event `number`: the interrupt was held up for more
    /// than an interval. The events that are owed follow now, a short way apart, so that the later ones are on time.
    #[cold]
    fn make_up<T: UpdateTimer, P: OutputPort>(
        &self,
        number: u16,
        mut after: After,
        timer: &T,
        ports: &[P; PORTS],
    ) -> After {
        // An update that has just come is not missed: it will be served.
        let due = u16::from(timer.is_update_due());
        let missed = timer.update_count().wrapping_sub(number).wrapping_sub(due) & MOST_EVENTS;
        for _ in 0..missed.min(MOST_MADE_UP) {
            if self.left.load() == DRY {
                break;
            }
            self.made_up.store(self.made_up.load().wrapping_add(1));
            self.hold(timer);
            after = self.event::<false, T, P>(timer, ports);
        }
        after
    }

    /// Waits as long as a pulse lasts at least.
    fn hold<T: UpdateTimer>(&self, timer: &T) {
        let start = timer.counter();
        let ticks = self.reloads[1].load();
        for _ in 0..MOST_LOOKS {
            // A counter that has begun anew since makes the difference huge.
            if timer.counter().wrapping_sub(start) > ticks {
                break;
            }
        }
    }

    #[inline(always)]
    fn slot(&self) -> &Slot<PORTS> {
        self.at(self.played.load())
    }

    #[inline(always)]
    fn at(&self, number: u32) -> &Slot<PORTS> {
        &self.slots[number as usize & (N - 1)]
    }

    /// For the producer: the slot of a number.
    pub(super) fn slot_of(&self, number: u32) -> &Slot<PORTS> {
        self.at(number)
    }

    /// For the producer: slots played so far, modulo 2^32.
    pub(super) fn played(&self) -> u32 {
        self.played.load()
    }

    /// For the producer, while the interrupt is masked: events of the present slot that are still to come; 0 without one.
    pub(super) fn events_left(&self) -> u32 {
        let left = self.left.load();
        let left = if left < DRY { left ^ LEFT } else { left };
        (left + 1) as u32
    }

    /// For the producer, before the interrupt runs: how long a pulse is.
    pub(super) fn set_pulse_reload(&self, reload: u32) {
        self.reloads[1].store(reload);
    }

    /// For the producer, while the interrupt is masked: forgets all slots up to `filled`, the next to be filled.
    pub(super) fn forget(&self, filled: u32) {
        let mut number = self.played.load();
        while number != filled {
            self.at(number).clear();
            number = number.wrapping_add(1);
        }
        self.played.store(filled);
        self.left.store(DRY);
        for word in &self.words {
            word.store(0);
        }
        self.link.stopped();
    }
}
