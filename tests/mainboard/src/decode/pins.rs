//! Decodes edges into step events.

use serde::{Deserialize, Serialize};

use super::digest::order_digest;
use crate::pins::Pin;
use crate::wiring::{Board, Printer};

/// The outputs of a motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MotorWires {
    /// The step pin.
    pub step: Pin,
    /// The direction pin: high is backwards.
    pub direction: Pin,
    /// The enable pin: low is on.
    pub enable: Pin,
    /// True for an inverted direction, where low is backwards.
    pub inverted: bool,
}

/// Steps that left together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// The instant of the first of them, ns.
    pub at_ns: u64,
    /// The motors that stepped: bit 0 = x, 1 = y, 2 = z, 3 = e.
    pub axes: u8,
    /// Those of them that stepped backwards, in the same bits.
    pub directions: u8,
}

/// The shortest times that the drivers saw, ns; `u64::MAX` before the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Smallest {
    /// High time of a step signal.
    pub high_ns: u64,
    /// Low time of a step signal, between two high ones.
    pub low_ns: u64,
    /// Time between two events.
    pub gap_ns: u64,
    /// Time from a change of direction to the next step.
    pub direction_setup_ns: u64,
    /// Time from a step to the next change of direction.
    pub direction_hold_ns: u64,
}

impl Smallest {
    /// Times before the first edge.
    pub const NONE: Self = Self {
        high_ns: u64::MAX,
        low_ns: u64::MAX,
        gap_ns: u64::MAX,
        direction_setup_ns: u64::MAX,
        direction_hold_ns: u64::MAX,
    };

    /// The shorter of high and low time, ns.
    #[must_use]
    pub fn pulse_ns(&self) -> u64 {
        self.high_ns.min(self.low_ns)
    }
}

/// One motor's state.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Motor {
    position: i64,
    steps: u64,
    steps_while_off: u64,
    step_high: Option<bool>,
    direction_high: bool,
    enable_high: Option<bool>,
    step_edge_ns: Option<u64>,
    last_step_ns: Option<u64>,
    direction_edge_ns: Option<u64>,
}

/// Decodes edges in the order of time into step events.
///
/// A pin's first edge also shows its level before. A motor is off until its enable pin goes low,
/// because drivers pull it high. Steps of a motor that is off belong to the order but move nothing;
/// they are counted separately.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Decoder {
    wires: Vec<MotorWires>,
    both_edges: bool,
    event_window_ns: u64,
    motors: Vec<Motor>,
    open: Option<Event>,
    events: Vec<Event>,
    last_event_ns: Option<u64>,
    last_edge_ns: u64,
    smallest: Smallest,
    repeated_levels: u64,
    foreign_edges: u64,
    out_of_order: u64,
}

impl Decoder {
    /// A decoder for a board's motors x, y, z and e with a printer's signals. Steps of different
    /// motors within `event_window_ns` after the first are one event: the firmware stores to one
    /// port after the other.
    #[must_use]
    pub fn new(board: &Board, printer: &Printer, event_window_ns: u64) -> Self {
        let inverted = printer.signals.inverted;
        let wires = board.motors.iter().zip(inverted).map(|(motor, inverted)| MotorWires {
            step: motor.step,
            direction: motor.direction,
            enable: motor.enable,
            inverted,
        });
        Self::with_wires(wires.collect(), printer.signals.both_edges, event_window_ns)
    }

    /// A decoder for up to 8 motors; further ones are ignored.
    #[must_use]
    pub fn with_wires(mut wires: Vec<MotorWires>, both_edges: bool, event_window_ns: u64) -> Self {
        wires.truncate(8);
        Self {
            motors: vec![Motor::default(); wires.len()],
            wires,
            both_edges,
            event_window_ns,
            open: None,
            events: Vec::new(),
            last_event_ns: None,
            last_edge_ns: 0,
            smallest: Smallest::NONE,
            repeated_levels: 0,
            foreign_edges: 0,
            out_of_order: 0,
        }
    }

    /// Processes an edge: `pin` became `high`. Edges come in the order of time.
    pub fn edge(&mut self, at_ns: u64, pin: Pin, high: bool) {
        if at_ns < self.last_edge_ns {
            self.out_of_order += 1;
        }
        self.last_edge_ns = self.last_edge_ns.max(at_ns);
        let mut known = false;
        for index in 0..self.wires.len() {
            let wires = self.wires[index];
            if pin == wires.enable {
                known = true;
                self.motors[index].enable_high = Some(high);
            }
            if pin == wires.direction {
                known = true;
                self.direction_edge(index, at_ns, high);
            }
            if pin == wires.step {
                known = true;
                self.step_edge(index, at_ns, high);
            }
        }
        self.foreign_edges += u64::from(!known);
    }

    fn direction_edge(&mut self, index: usize, at_ns: u64, high: bool) {
        let motor = &mut self.motors[index];
        if motor.direction_high == high {
            // The first edge may repeat a level that the pin always had: only edges
            // after a step count.
            self.repeated_levels += u64::from(motor.last_step_ns.is_some());
            return;
        }
        motor.direction_high = high;
        motor.direction_edge_ns = Some(at_ns);
        if let Some(step_ns) = motor.last_step_ns {
            let hold_ns = at_ns.saturating_sub(step_ns);
            self.smallest.direction_hold_ns = self.smallest.direction_hold_ns.min(hold_ns);
        }
    }

    fn step_edge(&mut self, index: usize, at_ns: u64, high: bool) {
        let motor = &mut self.motors[index];
        if motor.step_high == Some(high) {
            self.repeated_levels += 1;
            return;
        }
        motor.step_high = Some(high);
        if let Some(before_ns) = motor.step_edge_ns.replace(at_ns) {
            let time_ns = at_ns.saturating_sub(before_ns);
            let least = if high { &mut self.smallest.low_ns } else { &mut self.smallest.high_ns };
            *least = time_ns.min(*least);
        }
        if !(high || self.both_edges) {
            return;
        }
        let backwards = motor.direction_high != self.wires[index].inverted;
        motor.position += if backwards { -1 } else { 1 };
        motor.steps += 1;
        motor.steps_while_off += u64::from(motor.enable_high != Some(false));
        motor.last_step_ns = Some(at_ns);
        if let Some(changed_ns) = motor.direction_edge_ns.take() {
            let setup_ns = at_ns.saturating_sub(changed_ns);
            self.smallest.direction_setup_ns = self.smallest.direction_setup_ns.min(setup_ns);
        }
        self.step(at_ns, 1 << index, u8::from(backwards) << index);
    }

    fn step(&mut self, at_ns: u64, axis: u8, direction: u8) {
        if let Some(open) = &mut self.open
            && open.axes & axis == 0
            && at_ns.saturating_sub(open.at_ns) <= self.event_window_ns
        {
            open.axes |= axis;
            open.directions |= direction;
            return;
        }
        self.close();
        self.open = Some(Event { at_ns, axes: axis, directions: direction });
    }

    fn close(&mut self) {
        let Some(event) = self.open.take() else { return };
        if let Some(before_ns) = self.last_event_ns.replace(event.at_ns) {
            self.smallest.gap_ns = self.smallest.gap_ns.min(event.at_ns.saturating_sub(before_ns));
        }
        self.events.push(event);
    }

    /// The events so far, except the last one, which another step may still join.
    #[must_use]
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Ends the last event and returns all events.
    pub fn finish(&mut self) -> &[Event] {
        self.close();
        &self.events
    }

    /// FNV-1a-64 of the events so far ([`order_digest`]).
    #[must_use]
    pub fn order_digest(&self) -> u64 {
        order_digest(self.events.iter().map(|event| (event.axes, event.directions)))
    }

    /// A motor's position, in steps from its start.
    #[must_use]
    pub fn position(&self, motor: usize) -> i64 {
        self.motors.get(motor).map_or(0, |motor| motor.position)
    }

    /// The number of steps of a motor, in both directions.
    #[must_use]
    pub fn steps(&self, motor: usize) -> u64 {
        self.motors.get(motor).map_or(0, |motor| motor.steps)
    }

    /// The number of steps of a motor while its driver was off.
    #[must_use]
    pub fn steps_while_off(&self, motor: usize) -> u64 {
        self.motors.get(motor).map_or(0, |motor| motor.steps_while_off)
    }

    /// The shortest times so far.
    #[must_use]
    pub fn smallest(&self) -> Smallest {
        self.smallest
    }

    /// The number of edges to the level that the pin already had: an edge in between was lost, or
    /// the caller reports levels.
    #[must_use]
    pub fn repeated_levels(&self) -> u64 {
        self.repeated_levels
    }

    /// The number of edges of pins that belong to no motor.
    #[must_use]
    pub fn foreign_edges(&self) -> u64 {
        self.foreign_edges
    }

    /// The number of edges earlier than their predecessor.
    #[must_use]
    pub fn out_of_order(&self) -> u64 {
        self.out_of_order
    }
}
