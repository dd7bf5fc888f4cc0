//! The drivers' serial line: several drivers on one wire, by bytes or by a pin's edges.
//!
//! [`Bus`] takes whole bytes, as a USART of the chip sends them. [`Wire`] takes a pin's edges, finds the bytes in them
//! and plays a reply back as edges at exact instants. Both share the drivers by address (data sheet of the TMC2209,
//! 4.3).
//!
//! | what | TMC2209, section | test |
//! |---|---|---|
//! | bit time from the sync nibble: four bits from the start bit to the third falling edge | 4.1.1 | `round_trip_*`, `a_given_*` |
//! | sampling in mid-bit, missing stop bit, pulses below 16 clocks | 4.1.1 | `a_missing_stop_bit_*`, `a_low_stop_bit_*`, `a_spike_*` |
//! | reply as edges, driver released four bit times after it | 4.1.2 | `round_trip_*`, `releases_*` |
//! | several drivers on one wire | 4.3 | `drivers_share_*`, `two_drivers_with_one_address_*` |
//! | garbled bits, mute line | | `garbles_*`, `a_mute_*` |
//!
//! Left out: the slope of edges; a driver that answers while the master still drives low (such edges are counted only).
//! The wire's time unit is a whole nanosecond for a bit: at 500 000 baud that is exact, at 115 200 0.006 % off.

use super::random::Random;
use super::tmc2209::Tmc2209;
use super::tmc2209::datagram::{BYTE_BITS, Reply};
use std::collections::VecDeque;

#[cfg(test)]
mod tests;

/// Bit times after its last bit for which a driver still drives the line (4.1.2).
const RELEASE_BITS: u64 = 4;
/// The parts of a sync nibble may differ by one over this.
const SYNC_TOLERANCE: u64 = 4;
/// A low pulse on an idle line that is shorter is a glitch, in ns: 16 clocks of 12 MHz (4.1.1).
const GLITCH_NS: u64 = 1_333;

/// Faults of a line.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LineFault {
    /// Probability (0 to 1) that a bit arrives the wrong way round, in either direction.
    pub garble: f64,
    /// No driver hears or says anything: the wire is off.
    pub mute: bool,
}

/// Drivers on one line, by bytes. The drivers themselves are the run's; the bus knows their places in the run's list.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Bus {
    members: Vec<usize>,
    fault: LineFault,
    random: Random,
}

impl Bus {
    /// A bus of these drivers; the seed is for garbled bits.
    pub fn new(members: Vec<usize>, seed: u64) -> Self {
        Self { members, fault: LineFault::default(), random: Random::new(seed) }
    }

    /// Breaks or mends the line.
    pub fn set_fault(&mut self, fault: LineFault) {
        self.fault = fault;
    }

    /// The drivers on it, by their places.
    pub fn members(&self) -> &[usize] {
        &self.members
    }

    /// Whether the next byte would begin a datagram for the drivers; none where no driver hears anything.
    fn expects_sync(&self, drivers: &[Tmc2209], start_ns: u64) -> Option<bool> {
        let mut hearing = self.members.iter().filter_map(|&member| drivers.get(member)).filter(|driver| driver.hears());
        hearing.next().map(|driver| driver.expects_sync(start_ns))
    }

    /// A byte from the master whose start bit began at `start_ns`; the reply that follows it on the wire.
    ///
    /// Two drivers that answer at once pull each other's high bits low: the reply is both, bit by bit.
    pub fn byte(&mut self, drivers: &mut [Tmc2209], start_ns: u64, bit_ns: u64, byte: u8) -> Option<Reply> {
        if self.fault.mute {
            return None;
        }
        let Some(byte) = self.garble(byte) else {
            self.garbled(drivers, start_ns + BYTE_BITS * bit_ns);
            return None;
        };
        let mut answer: Option<Reply> = None;
        let mut speaks = 0_u64;
        for (place, &member) in self.members.iter().enumerate() {
            let Some(driver) = drivers.get_mut(member) else { continue };
            let Some(reply) = driver.receive_byte(start_ns, bit_ns, byte) else { continue };
            speaks |= 1 << (place & 63);
            match &mut answer {
                None => answer = Some(reply),
                Some(first) => {
                    first.start_ns = first.start_ns.min(reply.start_ns);
                    for (mixed, other) in first.bytes.iter_mut().zip(reply.bytes) {
                        *mixed &= other;
                    }
                }
            }
        }
        let reply = answer.as_mut()?;
        for (place, &member) in self.members.iter().enumerate() {
            if speaks & 1 << (place & 63) == 0
                && let Some(driver) = drivers.get_mut(member)
            {
                driver.overhear(reply);
            }
        }
        if self.fault.garble > 0.0 {
            for byte in &mut reply.bytes {
                for bit in 0..8 {
                    *byte ^= u8::from(self.random.chance(self.fault.garble)) << bit;
                }
            }
        }
        answer
    }

    /// Something that was no byte, until `end_ns`: a break, a glitch.
    pub fn garbled(&mut self, drivers: &mut [Tmc2209], end_ns: u64) {
        if self.fault.mute {
            return;
        }
        for &member in &self.members {
            if let Some(driver) = drivers.get_mut(member) {
                driver.receive_garbled(end_ns);
            }
        }
    }

    /// The byte as it arrives; none where its start or stop bit is lost.
    fn garble(&mut self, byte: u8) -> Option<u8> {
        if self.fault.garble <= 0.0 {
            return Some(byte);
        }
        let flips = (0..10).fold(0_u16, |flips, bit| flips | u16::from(self.random.chance(self.fault.garble)) << bit);
        (flips & 0b10_0000_0001 == 0).then_some(byte ^ (flips >> 1) as u8)
    }
}

/// How a driver's end of the wire knows the length of a bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum BitTime {
    /// From the sync nibble, as the chip does.
    Measured,
    /// This many ns, always.
    Given(u64),
}

/// A byte on its way.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
struct Incoming {
    start_ns: u64,
    /// 0 while it is measured.
    bit_ns: u64,
    /// Edges since the start bit's: when, and the level after.
    edges: Vec<(u64, bool)>,
}

/// Drivers on one line, by edges of a pin.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Wire {
    bus: Bus,
    bit_time: BitTime,
    /// What the master drives; none while its pin is an input.
    master: Option<bool>,
    incoming: Option<Incoming>,
    /// Bit time of the newest datagram.
    bit_ns: u64,
    /// What drivers will drive, and when.
    outgoing: VecDeque<(u64, Option<bool>)>,
    driven: Option<bool>,
    conflicts: u64,
}

impl Wire {
    /// A wire at rest: it is not driven, and a resistor pulls it high.
    pub fn new(bus: Bus, bit_time: BitTime) -> Self {
        Self {
            bus,
            bit_time,
            master: None,
            incoming: None,
            bit_ns: 0,
            outgoing: VecDeque::new(),
            driven: None,
            conflicts: 0,
        }
    }

    /// The bus at its other end, to break or mend.
    pub fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    /// What the drivers drive on the wire just now; none when all listen.
    pub fn driven(&self) -> Option<bool> {
        self.driven
    }

    /// The level that the master's pin sees: a low from either end wins, left alone it is high.
    pub fn level(&self) -> bool {
        self.master.unwrap_or(true) && self.driven.unwrap_or(true)
    }

    /// How often master and driver drove against each other.
    pub fn conflicts(&self) -> u64 {
        self.conflicts
    }

    /// The master's pin drives this (none: it is an input) from now on.
    pub fn set_master(&mut self, drivers: &mut [Tmc2209], now_ns: u64, driven: Option<bool>) {
        self.advance(drivers, now_ns);
        let before = self.master.unwrap_or(true);
        self.master = driven;
        let level = driven.unwrap_or(true);
        if let (Some(master), Some(driver)) = (driven, self.driven) {
            self.conflicts += u64::from(master != driver);
        }
        // While a driver talks, none listens.
        if level != before && self.driven.is_none() {
            self.edge(drivers, now_ns, level);
        }
    }

    fn edge(&mut self, drivers: &mut [Tmc2209], now_ns: u64, level: bool) {
        let Some(incoming) = &mut self.incoming else {
            if level {
                return;
            }
            let bit_ns = match (self.bit_time, self.bus.expects_sync(drivers, now_ns)) {
                (_, None) => return,
                (BitTime::Given(bit_ns), _) => bit_ns,
                (BitTime::Measured, Some(true)) => 0,
                (BitTime::Measured, Some(false)) => self.bit_ns,
            };
            self.incoming = Some(Incoming { start_ns: now_ns, bit_ns, edges: vec![(now_ns, false)] });
            return;
        };
        if level && incoming.edges.len() == 1 && now_ns - incoming.start_ns < GLITCH_NS {
            self.incoming = None;
            self.bus.garbled(drivers, now_ns);
            return;
        }
        incoming.edges.push((now_ns, level));
        if incoming.bit_ns != 0 || level {
            return;
        }
        // Falling edges of the start bit, of bit 1 and of bit 3: 0 then 1 0 1 0 (the sync nibble, lowest bit first). A
        // nibble that does not fit was busy until its last rise, and another may begin here.
        let count = incoming.edges.len();
        let at_ns = |index: usize| incoming.edges.get(index).map_or(now_ns, |edge| edge.0);
        let (low_ns, first_ns, second_ns) = (at_ns(1) - at_ns(0), at_ns(2) - at_ns(0), now_ns - at_ns(0));
        let last_rise_ns = at_ns(count - 2);
        let fits = first_ns.abs_diff(2 * low_ns) * SYNC_TOLERANCE <= first_ns
            && (count == 3 || second_ns.abs_diff(2 * first_ns) * SYNC_TOLERANCE <= first_ns);
        if !fits {
            *incoming = Incoming { start_ns: now_ns, bit_ns: 0, edges: vec![(now_ns, false)] };
            self.bus.garbled(drivers, last_rise_ns);
            return;
        }
        if count < 5 {
            return;
        }
        incoming.bit_ns = ((now_ns - incoming.start_ns) / 4).max(1);
        self.bit_ns = incoming.bit_ns;
    }

    /// Lets due bytes arrive and due levels appear, up to now; whether the driven level changed.
    pub fn advance(&mut self, drivers: &mut [Tmc2209], now_ns: u64) -> bool {
        if let Some(incoming) = self.incoming.take_if(|byte| byte.end_ns().is_some_and(|end_ns| end_ns <= now_ns)) {
            self.receive(drivers, &incoming);
        }
        let before = self.driven;
        while let Some((_, driven)) = self.outgoing.pop_front_if(|&mut (at_ns, _)| at_ns <= now_ns) {
            self.driven = driven;
            if let (Some(master), Some(driver)) = (self.master, driven) {
                self.conflicts += u64::from(master != driver);
            }
        }
        self.driven != before
    }

    /// When a byte is complete or the drivers' level changes next.
    pub fn next_event_ns(&self) -> Option<u64> {
        let byte_ns = self.incoming.as_ref().and_then(Incoming::end_ns);
        let edge_ns = self.outgoing.front().map(|&(at_ns, _)| at_ns);
        byte_ns.into_iter().chain(edge_ns).min()
    }

    fn receive(&mut self, drivers: &mut [Tmc2209], incoming: &Incoming) {
        let Some(byte) = incoming.byte() else {
            self.bus.garbled(drivers, incoming.start_ns + BYTE_BITS * incoming.bit_ns);
            return;
        };
        if let Some(reply) = self.bus.byte(drivers, incoming.start_ns, incoming.bit_ns, byte) {
            self.play(&reply);
        }
    }

    /// Queues a reply's edges.
    fn play(&mut self, reply: &Reply) {
        let mut newest = None;
        for (index, &byte) in reply.bytes.iter().enumerate() {
            let frame = u16::from(byte) << 1 | 1 << 9;
            for bit in 0..BYTE_BITS {
                let level = Some(frame >> bit & 1 != 0);
                if level != newest {
                    let at_ns = reply.start_ns + (index as u64 * BYTE_BITS + bit) * reply.bit_ns;
                    self.outgoing.push_back((at_ns, level));
                    newest = level;
                }
            }
        }
        self.outgoing.push_back((reply.end_ns() + RELEASE_BITS * reply.bit_ns, None));
    }
}

impl Incoming {
    /// When its stop bit is sampled; none before its bit time is known.
    fn end_ns(&self) -> Option<u64> {
        (self.bit_ns != 0).then_some(self.start_ns + (2 * BYTE_BITS - 1) * self.bit_ns / 2)
    }

    fn sample(&self, bit: u64) -> bool {
        let at_ns = self.start_ns + (2 * bit + 1) * self.bit_ns / 2;
        self.edges.iter().rev().find(|(edge_ns, _)| *edge_ns <= at_ns).is_none_or(|&(_, level)| level)
    }

    /// The byte; none without its start bit or stop bit.
    fn byte(&self) -> Option<u8> {
        if self.sample(0) || !self.sample(9) {
            return None;
        }
        Some((1..=8).fold(0, |byte, bit| byte | u8::from(self.sample(bit)) << (bit - 1)))
    }
}
