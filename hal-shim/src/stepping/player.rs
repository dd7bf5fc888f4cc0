//! What the step interrupt does.

use core::marker::PhantomData;

use super::StepLink;
use super::slot::{Head, MOST_EVENTS, Slot};
use super::word::{WordI32, WordU32};

/// Events nearer than this (at 84 MHz: 0.36 us, 60 cycles) are played without leaving the interrupt: leaving and
/// entering take 22 cycles, and what is done around an event about as many.
pub const NEAR_TICKS: u32 = 30;

/// Most looks at the timer while the interrupt stays for near events. It plays fewer events than that, one after another,
/// and then leaves at least once: after this many times [`NEAR_TICKS`] = 46 us at most.
pub const MOST_LOOKS: u32 = 128;

/// The step timer, seen from the step interrupt. No method may wait.
pub trait UpdateTimer {
    /// Takes note of the update.
    fn clear_update(&self);
    /// Whether there was an update since.
    fn is_update_due(&self) -> bool;
    /// From the update after the next one on, an update every `reload` + 1 ticks.
    fn set_reload(&self, reload: u32);
    /// Sets the hardware's count of updates, modulo 2^15.
    fn set_update_count(&self, count: u16);
    /// Calls [`StepPlayer::stay`] as soon as [`StepPlayer::update`] has returned.
    fn call_stay(&self);
    /// After staying: updates that were served there do not call [`StepPlayer::update`] again.
    fn forget_served(&self);
    /// No more calls: there is nothing to play.
    fn mask(&self);
    /// Updates call again.
    fn unmask(&self);
}

/// The ports that carry a board's step and direction signals.
pub trait OutputPorts<const PORTS: usize> {
    /// The word's lower half's ones set pins of a port, 0 to `PORTS` - 1, the upper half's reset them, at once; zeros do
    /// nothing.
    fn write(&self, port: usize, word: u32);
}

/// How step signals step.
pub trait Stepping {
    /// Events that a step takes: one, or one for each edge of its pulse.
    const EVENTS_A_STEP: u32;
}

/// Each edge of the signal is a step (TMC drivers, `dedge`).
#[derive(Clone, Copy, Debug)]
pub struct BothEdges;
/// The rising edge is a step; the pulse ends in an event of its own, so that nobody waits for it.
#[derive(Clone, Copy, Debug)]
pub struct Pulses;

impl Stepping for BothEdges {
    const EVENTS_A_STEP: u32 = 1;
}

impl Stepping for Pulses {
    const EVENTS_A_STEP: u32 = 2;
}

/// What the step interrupt alone knows.
#[derive(Clone, Copy, Debug)]
pub struct NextWords<const PORTS: usize> {
    /// The words of the next event, and of the event after it if that is of the same slot.
    words: [[u32; 2]; PORTS],
}

impl<const PORTS: usize> NextWords<PORTS> {
    /// Nothing to put out.
    pub const NONE: Self = Self { words: [[0; 2]; PORTS] };
}

/// The ring of `N` slots, `N` a power of two, and how far they have been played.
///
/// There is one producer, [`super::StepFeeder`], and one interrupt that calls [`Self::update`]; [`Self::stay`] belongs to
/// it and never runs at the same time. Everything is a word that either side may load and store whole, so that no access
/// is unsafe.
#[derive(Debug)]
// In this order, so that what the interrupt uses is near the start.
#[repr(C)]
pub struct StepPlayer<M, const PORTS: usize, const N: usize> {
    /// The head of the present slot with the events that are still to come; [`Head::EMPTY`] when there is none. Counted
    /// upwards, for the sign tells what is usual in one instruction.
    left: WordI32,
    /// Number of the next slot, modulo 2^32; its place is the remainder by `N`.
    next: WordU32,
    /// For pulses: the reload values of the gap behind a pulse, and of the pulse.
    reloads: [WordU32; 2],
    link: StepLink,
    slots: [Slot<PORTS>; N],
    stepping: PhantomData<M>,
}

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
            left: WordI32::new(Head::EMPTY.0),
            next: WordU32::new(0),
            reloads: [const { WordU32::new(0) }; 2],
            link: StepLink::new(),
            slots: [const { Slot::empty() }; N],
            stepping: PhantomData,
        }
    }

    /// The flags.
    pub const fn link(&self) -> &StepLink {
        &self.link
    }

    /// The interrupt: puts out the event that is due and prepares the next. No lock, no float, no division, no panic, no
    /// call.
    ///
    /// The edges come first, at the same distance from the interrupt's entry whatever follows.
    #[inline(always)]
    pub fn update<T: UpdateTimer, P: OutputPorts<PORTS>>(&self, next: &mut NextWords<PORTS>, timer: &T, ports: &P) {
        timer.clear_update();
        let left = self.put_out(next, ports);
        if left < 0 {
            self.go_on(left, next, timer);
            return;
        }
        let slot = self.next_slot();
        let head = slot.head();
        if head.is_far() {
            self.begin(slot, head, head, next, timer);
        } else {
            timer.call_stay();
        }
    }

    /// What is not usual: the start of a motion; its end, when the last event of a slot is out and nothing follows; an
    /// event that is owed; and events so near each other that they are played here, up to a bound.
    ///
    /// An interrupt of its own, so that the usual one needs no more registers than it has for free; it comes right after
    /// that one, before the next update is served.
    #[inline(always)]
    pub fn stay<T: UpdateTimer, P: OutputPorts<PORTS>>(&self, next: &mut NextWords<PORTS>, timer: &T, ports: &P) {
        if self.link.is_stopping() {
            // Asked for before the stop came: a start would undo its mask, an owed event would step.
            return;
        }
        let starting = self.left() == Head::EMPTY;
        let left = if self.link.take_owed() { self.put_out(next, ports) } else { 0 };
        let near = if left < 0 {
            self.go_on(left, next, timer);
            false
        } else {
            self.turn(next, timer)
        };
        if starting {
            self.start(timer);
        }
        if near {
            let mut words = *next;
            let mut looks = MOST_LOOKS;
            while looks > 0 {
                looks -= 1;
                if timer.is_update_due() {
                    timer.clear_update();
                    let left = self.put_out(&words, ports);
                    if left < 0 {
                        self.go_on(left, &mut words, timer);
                    } else if !self.turn(&mut words, timer) {
                        break;
                    }
                }
            }
            *next = words;
        }
        timer.forget_served();
    }

    /// The first slot of a motion is there: from here on the updates count, and call.
    ///
    /// The gap that runs is that of the slot before, or the idle one; so the event that was held back until its follower
    /// came is as far from the one before it as it should be, and the gap behind it is its slot's.
    #[inline(always)]
    fn start<T: UpdateTimer>(&self, timer: &T) {
        let head = self.left();
        if head == Head::EMPTY {
            return;
        }
        for _ in 0..MOST_LOOKS {
            timer.clear_update();
            timer.set_update_count(head.number().wrapping_sub(head.events() as u16) & MOST_EVENTS);
            // An update that came in between would be half of a start.
            if !timer.is_update_due() {
                break;
            }
        }
        let reload = self.slot(self.next.load().wrapping_sub(1)).reload();
        timer.unmask();
        // Once more: QEMU's timer stands still after an update while it is masked, until it is told an interval.
        timer.set_reload(reload);
    }

    /// Stores the event's words. Returns the head of its slot without it, not below 0 after the last.
    #[inline(always)]
    fn put_out<P: OutputPorts<PORTS>>(&self, next: &NextWords<PORTS>, ports: &P) -> i32 {
        for (port, [word, _]) in next.words.iter().enumerate() {
            ports.write(port, *word);
        }
        self.left.load().wrapping_add(Head::EVENT)
    }

    /// The slot's next event, and for pulses the gap after it.
    #[inline(always)]
    fn go_on<T: UpdateTimer>(&self, left: i32, next: &mut NextWords<PORTS>, timer: &T) {
        for words in &mut next.words {
            let [_, then] = *words;
            *words = [then, then.rotate_right(16)];
        }
        self.left.store(left);
        if M::EVENTS_A_STEP == 2 {
            // A slot begins with the end of a pulse and ends with the start of one.
            timer.set_reload(self.reloads[(left >> 16 & 1) as usize].load());
        }
    }

    /// The last event of a slot is out: the next slot. Whether its events are near.
    #[inline(always)]
    fn turn<T: UpdateTimer>(&self, next: &mut NextWords<PORTS>, timer: &T) -> bool {
        let slot = self.next_slot();
        let head = slot.head();
        if head.is_near() {
            self.begin(slot, head, head.as_far(), next, timer);
            return true;
        }
        if head.0 >= 0 {
            timer.mask();
            self.left.store(Head::EMPTY.0);
            self.link.run_dry();
        } else {
            self.begin(slot, head, head, next, timer);
        }
        false
    }

    #[inline(always)]
    fn begin<T: UpdateTimer>(
        &self,
        slot: &Slot<PORTS>,
        head: Head,
        as_far: Head,
        next: &mut NextWords<PORTS>,
        timer: &T,
    ) {
        // In this order, so that few registers are in use at a time. The producer looks at `next`, which comes last.
        self.left.store(as_far.0);
        slot.clear(head);
        let reload = slot.reload();
        timer.set_reload(reload);
        if M::EVENTS_A_STEP == 2 {
            self.reloads[0].store(reload);
        }
        for (port, words) in next.words.iter_mut().enumerate() {
            *words = [slot.first(port), slot.then(port)];
        }
        // Loaded once more: a register less to keep.
        self.next.store(self.next.load().wrapping_add(1));
    }

    #[inline(always)]
    fn next_slot(&self) -> &Slot<PORTS> {
        self.slot(self.next.load())
    }

    #[inline(always)]
    fn slot(&self, number: u32) -> &Slot<PORTS> {
        &self.slots[number as usize & (N - 1)]
    }

    /// For the producer: a slot by its number.
    pub(super) fn slot_of(&self, number: u32) -> &Slot<PORTS> {
        self.slot(number)
    }

    /// For the producer: the slots from this number on to the end of the ring.
    #[inline(always)]
    pub(super) fn slots_from(&self, number: u32) -> &[Slot<PORTS>] {
        self.slots.get(number as usize & (N - 1)..).unwrap_or_default()
    }

    /// For the producer: the number of the next slot to be begun, modulo 2^32.
    pub(super) fn next_number(&self) -> u32 {
        self.next.load()
    }

    /// For the producer: what is left of the slot in play.
    pub(super) fn left(&self) -> Head {
        Head(self.left.load())
    }

    /// For the producer, before the interrupt runs: how long a pulse is.
    pub(super) fn set_pulse_reload(&self, reload: u32) {
        self.reloads[1].store(reload);
    }

    /// For the producer, while the interrupt is masked: forgets all slots up to the one that it fills next. Whether more
    /// than a sensor has asked for that.
    pub(super) fn forget(&self, filled: u32) -> bool {
        let mut number = self.next.load();
        while number != filled {
            let slot = self.slot(number);
            slot.clear(slot.head());
            number = number.wrapping_add(1);
        }
        self.next.store(filled);
        self.left.store(Head::EMPTY.0);
        self.link.stopped()
    }
}
