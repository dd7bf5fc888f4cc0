//! The chip's end of the four wires: frames from edges.

use serde::{Deserialize, Serialize};

use super::{DATAX0, DATAZ1, FIFO_STATUS};

/// Shortest period, and high or low time, of the clock, ns (*SPI timing*: 5 MHz, 0.3 of a period).
const PERIOD_NS: u64 = 200;
const HALF_NS: u64 = 60;
/// Shortest time between two frames, ns.
const DESELECTED_NS: u64 = 150;
/// Shortest time from the end of a sample's read to the beginning of the next, or of a read of
/// FIFO_STATUS, ns.
const BETWEEN_SAMPLES_NS: u64 = 5_000;

/// Counts of what came too soon.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Violations {
    /// An edge of the clock.
    pub clock: u64,
    /// A frame after another.
    pub frame: u64,
    /// A sample, or FIFO_STATUS, after a sample.
    pub sample: u64,
}

/// Request that a whole byte makes.
pub(super) enum Byte {
    /// The value of this register, for the next byte.
    Read(u8),
    /// This register has a new value.
    Written(u8, u8),
}

/// A frame's first byte.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Command {
    reads: bool,
    many: bool,
    register: u8,
}

/// The wires, and the frame under way.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Bus {
    selected: bool,
    clock: bool,
    data: bool,
    bits: u32,
    received: u8,
    sent: u8,
    level: bool,
    command: Option<Command>,
    reads_data: bool,
    fell_ns: Option<u64>,
    edge_ns: u64,
    deselected_ns: Option<u64>,
    sample_ended_ns: Option<u64>,
    violations: Violations,
}

impl Default for Bus {
    /// At rest: deselected, the clock high.
    fn default() -> Self {
        Self {
            selected: false,
            clock: true,
            data: false,
            bits: 0,
            received: 0,
            sent: 0,
            level: false,
            command: None,
            reads_data: false,
            fell_ns: None,
            edge_ns: 0,
            deselected_ns: None,
            sample_ended_ns: None,
            violations: Violations::default(),
        }
    }
}

impl Bus {
    pub fn output(&self) -> Option<bool> {
        self.selected.then_some(self.level)
    }

    pub fn violations(&self) -> Violations {
        self.violations
    }

    pub fn set_data(&mut self, high: bool) {
        self.data = high;
    }

    /// True at the end of a frame that read data.
    pub fn set_select(&mut self, now_ns: u64, high: bool) -> bool {
        if self.selected != high {
            return false;
        }
        self.selected = !high;
        if high {
            self.deselected_ns = Some(now_ns);
            let read_data = std::mem::take(&mut self.reads_data);
            if read_data {
                self.sample_ended_ns = Some(now_ns);
            }
            return read_data;
        }
        self.violations.frame += u64::from(self.deselected_ns.is_some_and(|at_ns| now_ns < at_ns + DESELECTED_NS));
        (self.bits, self.sent, self.command, self.fell_ns) = (0, 0, None, None);
        false
    }

    /// The whole byte that ends with this edge.
    pub fn set_clock(&mut self, now_ns: u64, high: bool) -> Option<Byte> {
        if self.clock == high {
            return None;
        }
        self.clock = high;
        if !self.selected {
            return None;
        }
        let is_first = self.bits == 0 && !high;
        self.violations.clock += u64::from(!is_first && now_ns < self.edge_ns + HALF_NS);
        self.edge_ns = now_ns;
        if !high {
            self.violations.clock += u64::from(self.fell_ns.is_some_and(|at_ns| now_ns < at_ns + PERIOD_NS));
            self.fell_ns = Some(now_ns);
            self.level = self.sent >> (7 - self.bits % 8) & 1 == 1;
            return None;
        }
        self.received = self.received << 1 | u8::from(self.data);
        self.bits += 1;
        if !self.bits.is_multiple_of(8) {
            return None;
        }
        let byte = self.received;
        match &mut self.command {
            None => {
                let command = Command { reads: byte & 0x80 != 0, many: byte & 0x40 != 0, register: byte & 0x3f };
                self.command = Some(command);
                command.reads.then_some(Byte::Read(command.register))
            }
            Some(command) => {
                let register = command.register;
                command.register = (register + u8::from(command.many)) & 0x3f;
                Some(if command.reads { Byte::Read(command.register) } else { Byte::Written(register, byte) })
            }
        }
    }

    /// The value of the register that was asked for.
    pub fn answer(&mut self, now_ns: u64, register: u8, value: u8) {
        self.sent = value;
        let is_data = (DATAX0..=DATAZ1).contains(&usize::from(register));
        let is_first = self.bits == 8;
        if is_first && (is_data || usize::from(register) == FIFO_STATUS) {
            let is_soon = self.sample_ended_ns.is_some_and(|at_ns| now_ns < at_ns + BETWEEN_SAMPLES_NS);
            self.violations.sample += u64::from(is_soon);
        }
        self.reads_data |= is_first && is_data;
    }
}
