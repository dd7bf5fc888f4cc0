//! The log of the motors' pins.

use ferrostep_mainboard::decode::Event;
use ferrostep_mainboard::machine::Machine;
use ferrostep_testkit::boards::BoardFacts;

use crate::firmware::port_log::{PortState, PortWrite};

/// Motors that step simultaneously.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinEvent {
    /// Bit i = motor i steps.
    pub axes: u8,
    /// Bit i = motor i steps backwards.
    pub directions: u8,
}

/// The step events of a run.
#[derive(Clone, Debug)]
pub struct PinLog {
    events: Vec<PinEvent>,
    /// The same with their times.
    timed: Vec<Event>,
    motors_disabled: bool,
}

impl PinLog {
    /// The log of a machine's motors so far.
    pub fn of(machine: &Machine, board: &BoardFacts) -> Self {
        // The last event may still be open; ending it needs a copy.
        let mut decoder = machine.decoder.clone();
        let timed = decoder.finish().to_vec();
        let mut state = PortState::new();
        machine.stores().iter().filter_map(PortWrite::of).for_each(|write| state.apply(write));
        let is_off = |enable: &(char, u8)| !state.is_output(*enable) || state.is_high(*enable);
        let events = timed.iter().map(|event| PinEvent { axes: event.axes, directions: event.directions }).collect();
        Self { events, timed, motors_disabled: board.all_enable().iter().all(is_off) }
    }

    /// A log of these events, without times.
    pub fn new(events: Vec<PinEvent>, motors_disabled: bool) -> Self {
        Self { events, timed: Vec::new(), motors_disabled }
    }

    /// The last steps, in order, with their times.
    pub fn last(&self, count: usize) -> &[Event] {
        &self.timed[self.timed.len().saturating_sub(count)..]
    }

    /// All steps, in order.
    pub fn events(&self) -> &[PinEvent] {
        &self.events
    }

    /// True if all motors are switched off.
    pub fn motors_disabled(&self) -> bool {
        self.motors_disabled
    }

    /// FNV-1a-64 over the (axes, directions) bytes of all events.
    pub fn order_digest(&self) -> u64 {
        ferrostep_mainboard::decode::order_digest(self.events.iter().map(|event| (event.axes, event.directions)))
    }

    /// Steps of each motor, both directions added.
    pub fn issued(&self) -> [u64; 4] {
        let mut issued = [0; 4];
        for event in &self.events {
            for (motor, steps) in issued.iter_mut().enumerate() {
                *steps += u64::from(event.axes >> motor & 1);
            }
        }
        issued
    }

    /// Each motor's position relative to its position at reset, in steps.
    pub fn displacement(&self) -> [i64; 4] {
        let mut displacement = [0; 4];
        for event in &self.events {
            for (motor, steps) in displacement.iter_mut().enumerate() {
                *steps += i64::from(event.axes >> motor & 1) - 2 * i64::from(event.directions >> motor & 1);
            }
        }
        displacement
    }
}
