//! The code of the step interrupt.

use core::marker::PhantomData;

use super::StepLink;
use super::past::{Marks, Past, PastSlot, PositionMark};
use super::pins::PinMap;
use super::shared_word::{WordI32, WordU32};
use super::slot::{Head, MAX_EVENTS, Slot};

/// Minimum number of ticks between two updates of the timer: 1 us at 84 MHz, 168 cycles of the
/// core.
///
/// The reload value that an event's interrupt stores sets the gap after the next update, so the
/// store must arrive before that update; a late one repeats the old gap. The image build derives
/// the worst-case time from its instructions, and fails if that is longer than this.
/// [`super::StepFeeder`] refuses entries with a shorter gap, and makes pulses at least as long.
pub const MIN_GAP_TICKS: u32 = 84;

/// Interval at which an idle player looks for the first entry of a motion, ticks: a motion starts
/// at most two intervals late.
pub const IDLE_TICKS: u32 = 21_000;

/// Attempts to set the hardware's count of updates at the start of a motion. A second one is needed
/// only if an update falls between two stores.
const COUNT_ATTEMPTS: u32 = 4;

/// The step timer, seen from the step interrupt. No method may wait.
pub trait UpdateTimer {
    /// Clears the update's flag.
    fn clear_update(&self);
    /// Returns true if there has been an update since the flag was cleared.
    fn is_update_due(&self) -> bool;
    /// Sets the interval from the update after the next one on: an update every `reload` + 1 ticks.
    fn set_reload(&self, reload: u32);
    /// Sets the hardware's count of updates, modulo 2^15.
    fn set_update_count(&self, count: u16);
    /// Calls [`StepPlayer::start_or_end`] as soon as [`StepPlayer::update`] has returned.
    fn call_start_or_end(&self);
    /// Clears the pending interrupt of an update whose flag was cleared without playing it.
    fn forget_served(&self);
    /// Masks the update interrupt when no slot is left to play.
    fn mask(&self);
    /// Unmasks the update interrupt.
    fn unmask(&self);
}

/// The ports that carry a board's step and direction signals.
pub trait OutputPorts<const PORTS: usize> {
    /// Writes a word to a port, 0 to `PORTS` - 1, in one store: ones in the lower half set pins,
    /// ones in the upper half reset them, and zeros leave them unchanged.
    fn write(&self, port: usize, word: u32);
}

/// Choice of the edges of a step signal that make a step.
pub trait Stepping {
    /// Number of events that a step takes: one, or one for each edge of its pulse.
    const EVENTS_A_STEP: u32;
}

/// Each edge of the signal is a step (TMC drivers, `dedge`).
#[derive(Clone, Copy, Debug)]
pub struct BothEdges;
/// Steps at the rising edge; the pulse ends in a separate event, so that no code waits for it.
#[derive(Clone, Copy, Debug)]
pub struct Pulses;

impl Stepping for BothEdges {
    const EVENTS_A_STEP: u32 = 1;
}

impl Stepping for Pulses {
    const EVENTS_A_STEP: u32 = 2;
}

/// State private to the step interrupt.
#[derive(Clone, Copy, Debug)]
pub struct NextWords<const PORTS: usize> {
    /// Words of the next event, and of the event after it if that belongs to the same slot.
    words: [[u32; 2]; PORTS],
}

impl<const PORTS: usize> NextWords<PORTS> {
    /// No event prepared.
    pub const NONE: Self = Self { words: [[0; 2]; PORTS] };
}

/// The ring of `N` slots, `N` a power of two, and how far they have been played.
///
/// There is one producer, [`super::StepFeeder`], and one interrupt that calls [`Self::update`];
/// [`Self::start_or_end`] belongs to the interrupt and never runs at the same time. All shared
/// state consists of words that either side may load and store whole, so no access is unsafe.
#[derive(Debug)]
// In this order, so that the interrupt's fields are near the start.
#[repr(C)]
pub struct StepPlayer<M, const PORTS: usize, const N: usize> {
    /// Head of the present slot with the number of remaining events; [`Head::EMPTY`] without a
    /// slot. Counted upwards, so that one instruction tests the sign for the usual case.
    left: WordI32,
    /// Number of the next slot, modulo 2^32; its index is the remainder by `N`.
    next: WordU32,
    /// Reload values of pulses: for the gap after a pulse, and for the pulse itself.
    reloads: [WordU32; 2],
    link: StepLink,
    slots: [Slot<PORTS>; N],
    /// Words needed to read the ring after a stop or a reset. The interrupt does not touch them.
    marks: Marks,
    stepping: PhantomData<M>,
}

/// Maximum number of ports that carry a board's motor signals.
const MOST_PORTS: usize = 4;

/// Performs an action for each port. Unrolled at every optimisation level: the branches of a loop
/// would delay the edges.
#[inline(always)]
fn each_port<const PORTS: usize>(mut action: impl FnMut(usize)) {
    const { assert!(PORTS >= 1 && PORTS <= MOST_PORTS) };
    action(0);
    if PORTS > 1 {
        action(1);
    }
    if PORTS > 2 {
        action(2);
    }
    if PORTS > 3 {
        action(3);
    }
}

impl<M: Stepping, const PORTS: usize, const N: usize> Default for StepPlayer<M, PORTS, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<M: Stepping, const PORTS: usize, const N: usize> StepPlayer<M, PORTS, N> {
    /// Creates a player with an empty ring.
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two() && N >= 8 && N <= 1 << 15) };
        Self {
            left: WordI32::new(Head::EMPTY.0),
            next: WordU32::new(0),
            reloads: [const { WordU32::new(0) }; 2],
            link: StepLink::new(),
            slots: [const { Slot::empty() }; N],
            marks: Marks::new(),
            stepping: PhantomData,
        }
    }

    /// The flags shared with the planner task.
    pub const fn link(&self) -> &StepLink {
        &self.link
    }

    /// Interrupt handler: puts out the event that is due and prepares the next. No lock, no float,
    /// no division, no panic, no call.
    ///
    /// The edges come first, at a constant time after the interrupt's entry whatever follows; the
    /// reload value comes next, because it must arrive before the next update ([`MIN_GAP_TICKS`]).
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
        if head.is_filled() {
            self.begin(slot, head, next, timer);
        } else {
            timer.call_start_or_end();
        }
    }

    /// Starts a motion, or ends it when the last event is out and the ring is empty.
    ///
    /// This runs in a separate interrupt, so that the usual one needs no more registers than are
    /// free; the separate interrupt comes right after the usual one, before the next update is
    /// served.
    #[inline(always)]
    pub fn start_or_end<T: UpdateTimer>(&self, next: &mut NextWords<PORTS>, timer: &T) {
        if self.left() != Head::EMPTY {
            timer.mask();
            // An update that came before the mask belongs to no motion.
            timer.forget_served();
            // A slot that was filled in the meantime waits for the next start: its reload
            // value would be late.
            self.left.store(Head::EMPTY.0);
            self.link.run_dry();
        } else if self.link.is_running() && !self.link.is_stopping() {
            // Skipped if a stop has come since the start was requested: the start would undo its
            // mask.
            self.start(next, timer);
        }
    }

    /// Begins the first slot of a motion: from here on updates are counted and call the interrupt.
    ///
    /// The gap in progress is that of the last slot, or the idle one. So the event that was held
    /// back until its successor came keeps its distance from the one before, and the gap after it
    /// is that of its slot.
    #[inline(always)]
    fn start<T: UpdateTimer>(&self, next: &mut NextWords<PORTS>, timer: &T) {
        let slot = self.next_slot();
        let head = slot.head();
        if !head.is_filled() {
            self.link.run_dry();
            return;
        }
        let reload = slot.reload();
        self.begin(slot, head, next, timer);
        let count = head.number().wrapping_sub(head.events() as u16) & MAX_EVENTS;
        for _ in 0..COUNT_ATTEMPTS {
            timer.clear_update();
            timer.set_update_count(count);
            if !timer.is_update_due() {
                break;
            }
        }
        // A pending update from before belongs to no motion.
        timer.forget_served();
        // Last, because anything that follows delays the first event.
        timer.unmask();
        // Again: after an update while masked, QEMU's timer is stopped until it gets an interval.
        timer.set_reload(reload);
    }

    /// Stores the event's words. Returns the head of its slot without that event, not below 0 after
    /// the last.
    #[inline(always)]
    fn put_out<P: OutputPorts<PORTS>>(&self, next: &NextWords<PORTS>, ports: &P) -> i32 {
        each_port::<PORTS>(|port| {
            let [word, _] = next.words[port];
            ports.write(port, word);
        });
        self.left.load().wrapping_add(Head::EVENT)
    }

    /// Prepares the next event of the slot and, for pulses, the gap after it.
    #[inline(always)]
    fn go_on<T: UpdateTimer>(&self, left: i32, next: &mut NextWords<PORTS>, timer: &T) {
        if M::EVENTS_A_STEP == 2 {
            // A slot begins with the end of a pulse and ends with the start of one.
            timer.set_reload(self.reloads[(left >> 16 & 1) as usize].load());
        }
        self.left.store(left);
        each_port::<PORTS>(|port| {
            let [_, then] = next.words[port];
            next.words[port] = [then, then.rotate_right(16)];
        });
    }

    /// Prepares the first event of a slot.
    #[inline(always)]
    fn begin<T: UpdateTimer>(&self, slot: &Slot<PORTS>, head: Head, next: &mut NextWords<PORTS>, timer: &T) {
        let reload = slot.reload();
        timer.set_reload(reload);
        // This order keeps few registers in use at a time. The producer looks at `next`, which
        // comes last.
        self.left.store(head.0);
        slot.clear(head);
        if M::EVENTS_A_STEP == 2 {
            self.reloads[0].store(reload);
        }
        each_port::<PORTS>(|port| next.words[port] = [slot.first(port), slot.then(port)]);
        // Loaded again, which saves a register.
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

    /// Returns a slot by its number, for the producer.
    pub(super) fn slot_of(&self, number: u32) -> &Slot<PORTS> {
        self.slot(number)
    }

    /// Returns the slots from this number to the end of the ring, for the producer.
    #[inline(always)]
    pub(super) fn slots_from(&self, number: u32) -> &[Slot<PORTS>] {
        self.slots.get(number as usize & (N - 1)..).unwrap_or_default()
    }

    /// Number of the next slot to be begun, modulo 2^32, for the producer.
    pub(super) fn next_number(&self) -> u32 {
        self.next.load()
    }

    /// Head of the slot in play with its remaining events, for the producer.
    pub(super) fn left(&self) -> Head {
        Head(self.left.load())
    }

    /// Sets the length of a pulse, for the producer, before the interrupt runs.
    pub(super) fn set_pulse_reload(&self, reload: u32) {
        self.reloads[1].store(reload);
    }

    /// Notes the motor directions from the newest event on, for the producer; bit i = motor i runs
    /// backwards.
    pub(super) fn note_directions(&self, directions: u8) {
        self.marks.note_directions(directions);
    }

    /// Notes that a motion begins, for the producer, at standstill and with slots to play: from
    /// then on the slots left by a stop or a reset are overwritten.
    pub(super) fn motion_begins(&self) {
        self.marks.motion_begins(self.next.load());
    }

    /// Drops all slots before the one that the producer fills next, while the interrupt is masked.
    /// Returns true if anything other than a sensor asked for the stop.
    pub(super) fn forget(&self, filled: u32) -> bool {
        self.keep(filled);
        self.clear_unplayed(filled);
        self.link.stopped()
    }

    /// Records the played slots for [`Self::past`] once: after a second stop without a motion in
    /// between, the record of the first one stays.
    fn keep(&self, filled: u32) {
        if !self.marks.are_kept() {
            self.marks.keep(self.next.load(), self.left(), filled);
        }
    }

    /// Removes the unplayed slots from the ring. Their contents stay.
    fn clear_unplayed(&self, filled: u32) {
        let mut number = self.next.load();
        while number != filled {
            let slot = self.slot(number);
            slot.clear(slot.head());
            number = number.wrapping_add(1);
        }
        self.next.store(filled);
        self.left.store(Head::EMPTY.0);
    }
}

/// The past: contents of a ring that survived a stop, or a reset in memory that program start
/// leaves alone.
impl<M: Stepping, const PORTS: usize, const N: usize> StepPlayer<M, PORTS, N> {
    /// Prepares a player in memory that program start does not fill: no slot is left to play. If
    /// `is_trusted` (the supply was not interrupted) and the memory was a ring before, the slots
    /// stay readable; otherwise the ring is emptied. Call once, before the interrupt runs and
    /// before there is a feeder.
    pub fn restart(&self, is_trusted: bool) {
        if is_trusted && self.marks.are_valid() {
            self.finish_begun();
            let filled = self.first_empty();
            self.keep(filled);
            self.clear_unplayed(filled);
        } else {
            self.empty();
        }
        let _ = self.link.stopped();
    }

    /// Empties the ring. No slot that is still to be played may be in it.
    pub fn empty(&self) {
        for slot in &self.slots {
            slot.clear(Head::EMPTY);
        }
        self.next.store(0);
        self.left.store(Head::EMPTY.0);
        self.marks.reset();
    }

    /// Completes a [`Self::begin`] cut short by a reset: after the slot's head was taken, and
    /// before the slot was cleared, or before it was counted.
    fn finish_begun(&self) {
        let (head, left) = (self.next_slot().head(), self.left());
        if left == Head::EMPTY || head.number() != left.number() {
            return;
        }
        if head.is_filled() {
            self.left.store(Head::EMPTY.0);
        } else {
            self.next.store(self.next.load().wrapping_add(1));
        }
    }

    /// Number of the first empty slot from the next one on.
    fn first_empty(&self) -> u32 {
        let next = self.next.load();
        let filled = (0..N as u32).take_while(|number| self.slot(next.wrapping_add(*number)).head().is_filled());
        next.wrapping_add(filled.count() as u32)
    }

    /// Makes the recorded past begin here, at standstill.
    pub fn forget_past(&self) {
        self.marks.forget(self.next.load());
    }

    /// Number of motions begun so far, modulo 2^32.
    pub fn motions(&self) -> u32 {
        self.marks.motions()
    }

    /// Notes the motor position at the end of the queue, with `filled` slots filled so far; no
    /// effect while the remains of a stop or a reset are still to be read.
    pub fn note_position(&self, filled: u32, motor_steps: [i32; 4], now_ms: u32) {
        self.marks.note_position(PositionMark { filled, next: self.next.load(), now_ms, motor_steps });
    }

    /// Returns the contents of the ring: since the last stop or reset, or as that left it. At
    /// standstill only.
    pub fn past(&self) -> Past {
        self.marks.past(self.next.load(), N)
    }

    /// A slot of [`Self::past`], by its number. `None` if it holds anything but steps of these
    /// motors: memory that did not survive the reset.
    pub fn past_slot(&self, number: u32, pins: &PinMap<PORTS>) -> Option<PastSlot> {
        let slot = self.slot(number);
        let first: [u32; PORTS] = core::array::from_fn(|port| slot.first(port));
        let then: [u32; PORTS] = core::array::from_fn(|port| slot.then(port));
        let events = slot.head().number().wrapping_sub(self.slot(number.wrapping_sub(1)).head().number()) & MAX_EVENTS;
        let is_sound = pins.are_motors(first) && pins.are_motors(then) && events > 0 && slot.reload() > 0;
        is_sound.then(|| PastSlot {
            first: pins.stepping(first),
            then: pins.stepping(then),
            turned: pins.turning(first),
            backwards: pins.backwards(first),
            reload: slot.reload(),
            events,
        })
    }

    /// Length of a pulse as set by the feeder, ticks.
    pub fn pulse_ticks(&self) -> u32 {
        self.reloads[1].load().wrapping_add(1)
    }

    /// Number of events up to the end of the slot before the one filled next, modulo 2^15.
    pub(super) fn number_before(&self, filled: u32) -> u16 {
        self.slot(filled.wrapping_sub(1)).head().number()
    }
}
