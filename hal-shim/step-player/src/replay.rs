//! Replay of past slots by the interrupt's own code.

use core::cell::{Cell, RefCell};

use super::past::PastSlot;
use super::pins::{MotorPins, Pin, PinMap};
use super::player::{BothEdges, NextWords, OutputPorts, Pulses, StepPlayer, Stepping};
use super::slot::{Filling, Numbering};
use super::virtual_timer::{CYCLES_A_TICK, VirtualUpdateTimer};

/// Maximum number of slots that can be replayed: more than any board's ring has.
pub const MAX_REPLAYED_SLOTS: usize = 4095;

const RING: usize = MAX_REPLAYED_SLOTS + 1;

/// An event of a replay that makes a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Replayed {
    /// Ticks of the step timer since the first event.
    pub tick: u64,
    /// Index of its slot among those replayed. At the change from one slot to the next it is the
    /// index of the later slot, whose first event it is.
    pub slot: usize,
    /// Motors that step; bit i = motor i.
    pub axes: u8,
    /// Those of the stepping motors that run backwards.
    pub backwards: u8,
}

/// Plays slots as the board would: with `both_edges` as [`BothEdges`], otherwise as [`Pulses`] of
/// `pulse_ticks`. `directions` are those after the last slot (bit i = motor i runs backwards). The
/// replay ends after `events` events, whether they step or not. It skips slots after the first
/// [`MAX_REPLAYED_SLOTS`], and contents that no feeder writes: no events, or a reload value of 0.
pub fn replay(
    slots: &[PastSlot],
    both_edges: bool,
    pulse_ticks: u32,
    directions: u8,
    events: u64,
    stepped: impl FnMut(Replayed),
) {
    let slots = slots.get(..MAX_REPLAYED_SLOTS).unwrap_or(slots);
    // A motor that turned first ran the other way before.
    let backwards =
        slots.iter().rev().fold(directions, |before, slot| before & !slot.turned | slot.turned & !slot.backwards);
    if both_edges {
        play(&StepPlayer::<BothEdges, 1, RING>::new(), slots, pulse_ticks, backwards, events, stepped);
    } else {
        play(&StepPlayer::<Pulses, 1, RING>::new(), slots, pulse_ticks, backwards, events, stepped);
    }
}

/// Four motors on one port: the choice of pins has no influence on the steps.
fn pins() -> Option<PinMap<1>> {
    let pin = |number| Pin { port: 0, number };
    PinMap::new([0, 1, 2, 3].map(|motor| MotorPins { step: pin(motor), direction: pin(motor + 4) }))
}

/// Receives the words that the player stores.
struct Port<'a, F> {
    timer: &'a VirtualUpdateTimer,
    pins: &'a PinMap<1>,
    both_edges: bool,
    backwards: Cell<u8>,
    events: Cell<u64>,
    first_cycle: Cell<Option<u64>>,
    slot: Cell<usize>,
    stepped: RefCell<F>,
}

impl<F: FnMut(Replayed)> OutputPorts<1> for Port<'_, F> {
    fn write(&self, _: usize, word: u32) {
        let Some(left) = self.events.get().checked_sub(1) else { return };
        self.events.set(left);
        let now = self.timer.now_cycles();
        let first = self.first_cycle.get().unwrap_or(now);
        self.first_cycle.set(Some(first));
        let words = [word];
        let turned = self.pins.turning(words);
        self.backwards.set(self.backwards.get() & !turned | self.pins.backwards(words));
        // A pulse steps with its rising edge.
        let axes = self.pins.stepping(if self.both_edges { words } else { [word & 0xffff] });
        if axes != 0 {
            let (tick, backwards) = ((now - first) / CYCLES_A_TICK, self.backwards.get() & axes);
            if let Ok(mut stepped) = self.stepped.try_borrow_mut() {
                stepped(Replayed { tick, slot: self.slot.get(), axes, backwards });
            }
        }
    }
}

fn play<M: Stepping>(
    player: &StepPlayer<M, 1, RING>,
    slots: &[PastSlot],
    pulse_ticks: u32,
    backwards: u8,
    events: u64,
    stepped: impl FnMut(Replayed),
) {
    let both_edges = M::EVENTS_A_STEP == 1;
    let Some(pins) = pins() else { return };
    player.set_pulse_reload(pulse_ticks.max(2) - 1);
    let mut numbering = Numbering::new(M::EVENTS_A_STEP);
    for (filled, slot) in (0_u32..).zip(slots) {
        if slot.events == 0 || slot.events > super::MAX_EVENTS || slot.reload == 0 {
            break;
        }
        numbering.advance(slot.events.into());
        let [first] = pins.raised(slot.first);
        let first = if both_edges { first } else { PinMap::<1>::turned(first) };
        let [levels] = pins.directions(slot.backwards);
        let [changed] = pins.direction_pins(slot.turned);
        player.slot_of(filled).fill(&Filling {
            first: [first | levels & (changed | PinMap::<1>::turned(changed))],
            then: pins.raised(slot.then),
            reload: slot.reload,
            head: numbering.head(slot.events.into()),
        });
    }
    let timer = VirtualUpdateTimer::default();
    let port = Port {
        timer: &timer,
        pins: &pins,
        both_edges,
        backwards: Cell::new(backwards),
        events: Cell::new(events),
        first_cycle: Cell::new(None),
        slot: Cell::new(0),
        stepped: RefCell::new(stepped),
    };
    let mut next = NextWords::NONE;
    player.link().start();
    player.start_or_end(&mut next, &timer);
    while port.events.get() > 0 && !timer.is_masked() {
        port.slot.set(player.next_number().wrapping_sub(1) as usize);
        timer.next_update();
        timer.interrupt(player, &mut next, &port);
    }
}
