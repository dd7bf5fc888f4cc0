//! The drivers' serial line: several drivers on one wire, by bytes or by a pin's edges.
//!
//! [`Bus`] takes whole bytes, as a USART of the chip sends them. [`Wire`] takes a pin's edges,
//! decodes the bytes and plays a reply back as edges at exact instants. Both share the drivers by
//! address (data sheet of the TMC2209, 4.3).
//!
//! | what | TMC2209, section | test |
//! |---|---|---|
//! | bit time from the sync nibble: four bits from the start bit to the third falling edge | 4.1.1 | `round_trip_*`,
//! `a_given_*` |
//! | sampling in mid-bit, missing stop bit, pulses below 16 clocks | 4.1.1 | `a_missing_stop_bit_*`, `a_low_stop_bit_*`, `a_spike_*` |
//! | reply as edges, driver released four bit times after it | 4.1.2 | `round_trip_*`, `releases_*` |
//! | several drivers on one wire | 4.3 | `drivers_share_*`, `two_drivers_with_one_address_*` |
//! | garbled bits, mute line | | `garbles_*`, `a_mute_*` |
//!
//! Left out: the slope of edges; a driver that answers while the master still drives low (such
//! conflicts are only counted). The bit time is a whole number of nanoseconds: exact at 500 000
//! baud, 0.006 % off at 115 200.

use super::random::Random;
use super::tmc2209::Tmc2209;
use super::tmc2209::datagram::{BYTE_BITS, Reply};
use std::collections::VecDeque;

#[cfg(test)]
mod tests;

/// Bit times after its last bit during which a driver still drives the line (4.1.2).
const RELEASE_BITS: u64 = 4;
/// The parts of a sync nibble may differ by one over this.
const SYNC_TOLERANCE: u64 = 4;
/// Minimum low pulse on an idle line that is not a glitch, in ns: 16 clocks of 12 MHz (4.1.1).
const GLITCH_NS: u64 = 1_333;

/// Faults of a line.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LineFault {
    /// Probability (0 to 1) that a bit is inverted, in either direction.
    pub garble: f64,
    /// The wire is disconnected: no driver receives or sends.
    pub mute: bool,
}

/// Drivers on one line, by bytes. The run owns the drivers; the bus knows their indices.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Bus {
    members: Vec<usize>,
    fault: LineFault,
    random: Random,
}

impl Bus {
    /// A bus of these drivers; the seed determines garbled bits.
    pub fn new(members: Vec<usize>, seed: u64) -> Self {
        Self { members, fault: LineFault::default(), random: Random::new(seed) }
    }

    /// Breaks or mends the line.
    pub fn set_fault(&mut self, fault: LineFault) {
        self.fault = fault;
    }

    /// The indices of its drivers.
    pub fn members(&self) -> &[usize] {
        &self.members
    }

    /// True if the next byte would begin a datagram for the drivers; `None` if no driver receives.
    fn expects_sync(&self, drivers: &[Tmc2209], start_ns: u64) -> Option<bool> {
        let mut receiving =
            self.members.iter().filter_map(|&member| drivers.get(member)).filter(|driver| driver.receives());
        receiving.next().map(|driver| driver.expects_sync(start_ns))
    }

    /// Passes a byte from the master, whose start bit began at `start_ns`, to the drivers; returns
    /// the reply on the wire.
    ///
    /// Two drivers that answer at once pull each other's high bits low: the reply is the
    /// bitwise and of both.
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

    /// Reports activity that is not a byte, until `end_ns`: a break, a glitch.
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

    /// The byte as it arrives; `None` if its start or stop bit is lost.
    fn garble(&mut self, byte: u8) -> Option<u8> {
        if self.fault.garble <= 0.0 {
            return Some(byte);
        }
        let flips = (0..10).fold(0_u16, |flips, bit| flips | u16::from(self.random.chance(self.fault.garble)) << bit);
        (flips & 0b10_0000_0001 == 0).then_some(byte ^ (flips >> 1) as u8)
    }
}

/// Source of a bit's length at a driver's end of the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum BitTime {
    /// The time measured from the sync nibble, as the chip does.
    Measured,
    /// A constant number of ns.
    Given(u64),
}

/// A byte in transfer.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
struct Incoming {
    start_ns: u64,
    /// 0 while it is being measured.
    bit_ns: u64,
    /// Edges from the start bit on: instant, and the level after it.
    edges: Vec<(u64, bool)>,
}

/// Drivers on one line, by edges of a pin.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Wire {
    bus: Bus,
    bit_time: BitTime,
    /// The level that the master drives; `None` while its pin is an input.
    master: Option<bool>,
    incoming: Option<Incoming>,
    /// Bit time of the latest datagram.
    bit_ns: u64,
    /// Future levels from the drivers: instant, and level.
    outgoing: VecDeque<(u64, Option<bool>)>,
    driven: Option<bool>,
    conflicts: u64,
}

impl Wire {
    /// An idle wire: no end drives it, a resistor pulls it high.
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

    /// The bus of the wire, to break or mend.
    pub fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    /// The level that the drivers drive now; `None` while all listen.
    pub fn driven(&self) -> Option<bool> {
        self.driven
    }

    /// The level at the master's pin: low if either end drives low, high if neither drives.
    pub fn level(&self) -> bool {
        self.master.unwrap_or(true) && self.driven.unwrap_or(true)
    }

    /// The number of times that master and driver drove different levels.
    pub fn conflicts(&self) -> u64 {
        self.conflicts
    }

    /// Sets the level that the master's pin drives from now on; `None` for an input.
    pub fn set_master(&mut self, drivers: &mut [Tmc2209], now_ns: u64, driven: Option<bool>) {
        self.advance(drivers, now_ns);
        let before = self.master.unwrap_or(true);
        self.master = driven;
        let level = driven.unwrap_or(true);
        if let (Some(master), Some(driver)) = (driven, self.driven) {
            self.conflicts += u64::from(master != driver);
        }
        // No driver listens while one sends.
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
        // Falling edges of the start bit, of bit 1 and of bit 3: 0 then 1 0 1 0 (the sync nibble,
        // lowest bit first). A nibble that does not fit kept the line busy until its last rise, and
        // another may begin here.
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

    /// Delivers due bytes and levels up to `now_ns`; true if the driven level changed.
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

    /// The end of the current byte or the next change of the drivers' level, ns.
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
    /// The instant at which the stop bit is sampled; `None` before the bit time is known.
    fn end_ns(&self) -> Option<u64> {
        (self.bit_ns != 0).then_some(self.start_ns + (2 * BYTE_BITS - 1) * self.bit_ns / 2)
    }

    fn sample(&self, bit: u64) -> bool {
        let at_ns = self.start_ns + (2 * bit + 1) * self.bit_ns / 2;
        self.edges.iter().rev().find(|(edge_ns, _)| *edge_ns <= at_ns).is_none_or(|&(_, level)| level)
    }

    /// The byte; `None` without its start bit or stop bit.
    fn byte(&self) -> Option<u8> {
        if self.sample(0) || !self.sample(9) {
            return None;
        }
        Some((1..=8).fold(0, |byte, bit| byte | u8::from(self.sample(bit)) << (bit - 1)))
    }
}
