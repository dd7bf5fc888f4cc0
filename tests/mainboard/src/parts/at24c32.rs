//! The EEPROM AT24C32 on two open-drain wires (I2C), by edges.
//!
//! From the AT24C32E data sheet, DS20006109 (Microchip); times of a bus of 100 kHz from the
//! 24AA32A/24LC32A data sheet, DS21713, table 1-2, which the AT24C32E undercuts.
//!
//! | covered | section |
//! |---|---|
//! | start, stop, bytes, acknowledges, no acknowledge after the last byte read | 4 |
//! | an interrupted transfer: a start ends it, clocks end a byte that is read | 4.3 |
//! | device address with A2 to A0, word address of 12 bits | 6 |
//! | page write with a roll over in the page; the write begins at a stop after a whole byte | 7.2 |
//! | no acknowledge while it writes | 7.3, 7.4 |
//! | write protection by WP, seen at the stop: acknowledged and not written | 7.5 |
//! | current address, random and sequential read, roll over at the end | 8 |
//! | violations of the bus's times are counted ([`At24c32::violations`]) | table 1-2 |
//!
//! The power may go within a write: then each byte of the page is old, new, erased or random. Left
//! out: the software reset's own sequence, of which a start is a part; wear; spikes.

use serde::{Deserialize, Serialize};

use super::random::Random;

/// Bytes, and bytes of a page.
const BYTES: usize = 4096;
const PAGE: usize = 32;

/// Shortest times, ns: high, low, hold and set-up of a start, set-up of data and of a stop, free
/// between a stop and a start.
const HIGH_NS: u64 = 4_000;
const LOW_NS: u64 = 4_700;
const START_HOLD_NS: u64 = 4_000;
const START_SET_UP_NS: u64 = 4_700;
const DATA_SET_UP_NS: u64 = 250;
const STOP_SET_UP_NS: u64 = 4_000;
const FREE_NS: u64 = 4_700;

/// The chip's use of the next byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Expects {
    /// A start.
    Nothing,
    Address,
    High,
    Low,
    Data,
    /// The memory sends.
    Read,
}

/// A write under way.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Write {
    /// Places and their new bytes, all of a page.
    bytes: Vec<(usize, u8)>,
    until_ns: u64,
}

/// The chip.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct At24c32 {
    bytes: Vec<u8>,
    address: u8,
    write_ns: u64,
    plugged: bool,
    protected: bool,
    sda_stuck: bool,
    powered: bool,
    /// Levels that the other end asks for: released or low.
    scl: bool,
    sda: bool,
    /// The chip pulls SDA low.
    pulls: bool,
    expects: Expects,
    /// Bits of the byte under way, and how many.
    shift: u8,
    bits: u8,
    /// The other end's acknowledge of a byte read.
    more: bool,
    pointer: usize,
    latched: Vec<(usize, u8)>,
    write: Option<Write>,
    random: Random,
    pages_written: u64,
    violations: u64,
    scl_edge_ns: Option<u64>,
    sda_edge_ns: Option<u64>,
    start_ns: Option<u64>,
    stop_ns: Option<u64>,
}

impl At24c32 {
    /// A new chip, erased, with its pins A2 to A0 as the address's lowest bits; the seed determines
    /// what a cut leaves.
    pub fn new(address: u8, seed: u64) -> Self {
        Self {
            bytes: vec![0xff; BYTES],
            address,
            write_ns: 5_000_000,
            plugged: true,
            protected: false,
            sda_stuck: false,
            powered: true,
            scl: true,
            sda: true,
            pulls: false,
            expects: Expects::Nothing,
            shift: 0,
            bits: 0,
            more: false,
            pointer: 0,
            latched: Vec::new(),
            write: None,
            random: Random::new(seed),
            pages_written: 0,
            violations: 0,
            scl_edge_ns: None,
            sda_edge_ns: None,
            start_ns: None,
            stop_ns: None,
        }
    }

    /// The content, without a write under way.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Gives it another content, of the same length at most.
    pub fn set_bytes(&mut self, bytes: &[u8]) {
        self.bytes.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
    }

    /// Sets the time that writing a page takes, ns: 5 ms at most; 10 ms for older chips.
    pub fn set_write_ns(&mut self, write_ns: u64) {
        self.write_ns = write_ns;
    }

    /// Takes it off the board, or puts it on again.
    pub fn set_plugged(&mut self, plugged: bool) {
        self.plugged = plugged;
    }

    /// The level of WP.
    pub fn set_protected(&mut self, protected: bool) {
        self.protected = protected;
    }

    /// Something holds SDA low, whatever the chip does.
    pub fn set_sda_stuck(&mut self, stuck: bool) {
        self.sda_stuck = stuck;
    }

    /// Pages written so far.
    #[must_use]
    pub fn pages_written(&self) -> u64 {
        self.pages_written
    }

    /// Number of times the bus was faster than a bus of 100 kHz may be.
    #[must_use]
    pub fn violations(&self) -> u64 {
        self.violations
    }

    /// True if the chip, or a stuck line, pulls SDA low.
    #[must_use]
    pub fn pulls_sda(&self) -> bool {
        self.sda_stuck || self.pulls && self.plugged && self.powered
    }

    /// Switches its supply off or on.
    pub fn set_power(&mut self, now_ns: u64, powered: bool) {
        self.advance(now_ns);
        if powered == self.powered {
            return;
        }
        self.powered = powered;
        self.rest();
        let Some(Write { bytes, .. }) = self.write.take() else { return };
        let page = bytes.first().map_or(0, |(place, _)| place - place % PAGE);
        for place in page..page + PAGE {
            let old = self.bytes[place];
            let new = bytes.iter().rfind(|(to, _)| *to == place).map_or(old, |(_, byte)| *byte);
            self.bytes[place] = match self.random.between(0, 5) {
                0 => old,
                1 => 0xff,
                2 => self.random.bits() as u8,
                3 => new & self.random.bits() as u8,
                _ => new,
            };
        }
    }

    fn rest(&mut self) {
        (self.expects, self.pulls, self.bits, self.shift) = (Expects::Nothing, false, 0, 0);
        self.latched.clear();
    }

    /// Ends a write that is due.
    fn advance(&mut self, now_ns: u64) {
        if let Some(Write { bytes, .. }) = self.write.take_if(|write| write.until_ns <= now_ns) {
            for (place, byte) in bytes {
                self.bytes[place] = byte;
            }
            self.pages_written += 1;
        }
    }

    fn wire_sda(&self) -> bool {
        self.sda && !self.pulls_sda()
    }

    /// Counts an edge that comes sooner after an instant than it may.
    fn check(&mut self, since_ns: Option<u64>, now_ns: u64, shortest_ns: u64) {
        self.violations += u64::from(since_ns.is_some_and(|at_ns| now_ns < at_ns + shortest_ns));
    }

    /// The other end releases the clock (`true`) or pulls it low.
    pub fn set_scl(&mut self, now_ns: u64, high: bool) {
        self.advance(now_ns);
        if self.scl == high {
            return;
        }
        self.scl = high;
        if high {
            self.check(self.scl_edge_ns, now_ns, LOW_NS);
            self.check(self.sda_edge_ns, now_ns, DATA_SET_UP_NS);
            let level = self.wire_sda();
            self.rise(level);
        } else {
            self.check(self.scl_edge_ns, now_ns, HIGH_NS);
            self.check(self.start_ns, now_ns, START_HOLD_NS);
            self.fall();
        }
        self.scl_edge_ns = Some(now_ns);
    }

    /// The other end releases the data line (`true`) or pulls it low.
    pub fn set_sda(&mut self, now_ns: u64, high: bool) {
        self.advance(now_ns);
        let before = self.wire_sda();
        self.sda = high;
        let level = self.wire_sda();
        if level == before {
            return;
        }
        if self.scl {
            if level {
                self.check(self.scl_edge_ns, now_ns, STOP_SET_UP_NS);
                self.stop(now_ns);
            } else {
                self.check(self.scl_edge_ns, now_ns, START_SET_UP_NS);
                self.check(self.stop_ns, now_ns, FREE_NS);
                self.start_ns = Some(now_ns);
                self.rest();
                self.expects = Expects::Address;
            }
        }
        self.sda_edge_ns = Some(now_ns);
    }

    fn stop(&mut self, now_ns: u64) {
        self.stop_ns = Some(now_ns);
        let bytes = std::mem::take(&mut self.latched);
        // The rise of the clock before the stop counts as a bit; after a whole byte
        // it is the first.
        let is_whole = self.expects == Expects::Data && self.bits <= 1;
        if is_whole && !bytes.is_empty() && !self.protected && self.plugged && self.powered {
            self.write = Some(Write { bytes, until_ns: now_ns + self.write_ns });
        }
        self.rest();
    }

    /// A bit is on the line.
    fn rise(&mut self, level: bool) {
        if self.expects == Expects::Nothing {
            return;
        }
        if self.bits < 8 {
            self.shift = self.shift << 1 | u8::from(level);
        } else {
            self.more = !level;
        }
        self.bits += 1;
    }

    fn fall(&mut self) {
        match (self.expects, self.bits) {
            (Expects::Nothing, _) => {}
            (Expects::Read, 0..8) => self.pulls = self.sent() >> (7 - self.bits) & 1 == 0,
            (Expects::Read, 8) => self.pulls = false,
            (Expects::Read, _) => {
                self.pointer = (self.pointer + 1) % BYTES;
                self.bits = 0;
                if self.more {
                    self.pulls = self.sent() >> 7 == 0;
                } else {
                    self.rest();
                }
            }
            (_, 8) => self.take_byte(),
            (_, 9) => self.next_byte(),
            _ => {}
        }
    }

    fn sent(&self) -> u8 {
        self.bytes[self.pointer]
    }

    /// A byte is whole: it is acknowledged, or the chip waits for another start.
    fn take_byte(&mut self) {
        let byte = self.shift;
        match self.expects {
            Expects::Address if byte >> 1 != self.address || self.write.is_some() => return self.rest(),
            Expects::High => self.pointer = usize::from(byte & 0x0f) << 8,
            Expects::Low => self.pointer |= usize::from(byte),
            Expects::Data => {
                self.latched.push((self.pointer, byte));
                let page = self.pointer - self.pointer % PAGE;
                self.pointer = page + (self.pointer + 1) % PAGE;
            }
            _ => {}
        }
        self.pulls = true;
    }

    /// The acknowledge has ended.
    fn next_byte(&mut self) {
        let byte = std::mem::take(&mut self.shift);
        (self.bits, self.pulls) = (0, false);
        self.expects = match self.expects {
            Expects::Address if byte & 1 == 1 => Expects::Read,
            Expects::Address => Expects::High,
            Expects::High => Expects::Low,
            _ => Expects::Data,
        };
        if self.expects == Expects::Read {
            self.pulls = self.sent() >> 7 == 0;
        }
    }
}

#[cfg(test)]
mod tests;
