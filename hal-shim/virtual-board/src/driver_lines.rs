//! The serial lines of the virtual board's drivers, in virtual time.

use ferrostep_tmc2209::{DriverWiring, LineBusy, MOTORS, SingleWireUart};

use super::DriverChip;

/// Connections of the virtual board's drivers: all on one line, the addresses of the Prusa MINI's
/// board, and the sense resistors of the usual modules, 0.11 ohm.
pub const VIRTUAL_WIRING: [DriverWiring; MOTORS] = [
    DriverWiring { line: 0, address: 1, sense_milliohm: 110 },
    DriverWiring { line: 0, address: 3, sense_milliohm: 110 },
    DriverWiring { line: 0, address: 0, sense_milliohm: 110 },
    DriverWiring { line: 0, address: 2, sense_milliohm: 110 },
];

/// Bytes that may be on the line: a request's echo and a reply.
const UNDER_WAY: usize = 16;

/// Bits of a byte on the line.
const BYTE_BITS: u32 = 10;

/// Bit times from a request to its reply: NODECONF = 2 (data sheet, section 5.1).
const REPLY_DELAY_BITS: u32 = 24;

/// Lines with a chip for each motor that has one.
#[derive(Clone, Debug)]
pub struct VirtualDriverLines {
    chips: [Option<(u8, DriverChip)>; MOTORS],
    bit_ticks: u32,
    /// Bytes and their times of arrival.
    under_way: [(u32, u8); UNDER_WAY],
    first: usize,
    count: usize,
    busy_until: Option<u32>,
    /// Bytes in a thousand that are garbled.
    garbled_per_mille: u32,
    noise: u32,
    /// Maximum number of bytes of a datagram that are garbled, and how many of the present one are.
    most_garbled: u32,
    garbled: u32,
    is_held: bool,
    datagrams: u32,
}

impl VirtualDriverLines {
    /// Chips that have just got their supply. A bit takes `bit_ticks` of the caller's clock.
    #[must_use]
    pub fn new(wiring: [Option<DriverWiring>; MOTORS], bit_ticks: u32) -> Self {
        Self {
            chips: wiring.map(|wiring| wiring.map(|wiring| (wiring.line, DriverChip::new(wiring.address)))),
            bit_ticks,
            under_way: [(0, 0); UNDER_WAY],
            first: 0,
            count: 0,
            busy_until: None,
            garbled_per_mille: 0,
            noise: 0x2545_f491,
            most_garbled: u32::MAX,
            garbled: 0,
            is_held: false,
            datagrams: 0,
        }
    }

    /// A motor's chip.
    pub fn chip(&mut self, motor: usize) -> Option<&mut DriverChip> {
        self.chips.get_mut(motor).and_then(Option::as_mut).map(|(_, chip)| chip)
    }

    /// Sets the number of bytes in a thousand that are garbled on their way to a chip or back;
    /// `seed` chooses which.
    pub fn set_noise(&mut self, garbled_per_mille: u32, seed: u32) {
        self.garbled_per_mille = garbled_per_mille;
        self.noise = seed | 1;
    }

    /// Garbles at most this many bytes of a datagram. Its checksum, CRC-8, finds one garbled byte
    /// for certain; of several, one pattern in 256 passes for another datagram.
    pub fn set_most_garbled(&mut self, bytes: u32) {
        self.most_garbled = bytes;
    }

    /// The lines are held low: no byte arrives, not even an echo.
    pub fn set_held(&mut self, is_held: bool) {
        self.is_held = is_held;
    }

    /// Datagrams sent so far.
    #[must_use]
    pub const fn datagrams(&self) -> u32 {
        self.datagrams
    }

    /// Marsaglia's xorshift.
    fn random(&mut self) -> u32 {
        self.noise ^= self.noise << 13;
        self.noise ^= self.noise >> 17;
        self.noise ^= self.noise << 5;
        self.noise
    }

    /// The byte as it arrives.
    fn garbled(&mut self, byte: u8) -> u8 {
        if self.random() % 1000 < self.garbled_per_mille && self.garbled < self.most_garbled {
            self.garbled += 1;
            let flips = self.random() as u8;
            return byte ^ if flips == 0 { 1 } else { flips };
        }
        byte
    }

    fn comes(&mut self, byte: u8, at: u32) {
        if let Some(place) = self.under_way.get_mut((self.first + self.count) % UNDER_WAY)
            && self.count < UNDER_WAY
        {
            *place = (at, byte);
            self.count += 1;
        }
    }
}

impl SingleWireUart for VirtualDriverLines {
    fn send(&mut self, line: u8, bytes: &[u8], now_ticks: u32) -> Result<(), LineBusy> {
        let byte_ticks = BYTE_BITS * self.bit_ticks;
        if self.busy_until.is_some_and(|until| (now_ticks.wrapping_sub(until) as i32) < 0) {
            return Err(LineBusy);
        }
        self.datagrams += 1;
        self.count = 0;
        self.garbled = 0;
        let mut at = now_ticks;
        let mut arrived = [0; 8];
        let length = bytes.len().min(arrived.len());
        for (index, byte) in bytes.iter().take(length).enumerate() {
            at = at.wrapping_add(byte_ticks);
            let byte = self.garbled(*byte);
            if let Some(place) = arrived.get_mut(index) {
                *place = byte;
            }
            if !self.is_held {
                self.comes(byte, at);
            }
        }
        self.busy_until = Some(at);
        if self.is_held {
            return Ok(());
        }
        let arrived = arrived.get(..length).unwrap_or_default();
        let mut reply = None;
        for (_, chip) in self.chips.iter_mut().flatten().filter(|(on, _)| *on == line) {
            reply = chip.hear(arrived).or(reply);
        }
        at = at.wrapping_add(REPLY_DELAY_BITS * self.bit_ticks);
        self.garbled = 0;
        for byte in reply.into_iter().flatten() {
            at = at.wrapping_add(byte_ticks);
            let byte = self.garbled(byte);
            self.comes(byte, at);
        }
        Ok(())
    }

    fn receive(&mut self, now_ticks: u32) -> Option<u8> {
        let (at, byte) = self.under_way.get(self.first).copied()?;
        if self.count == 0 || (now_ticks.wrapping_sub(at) as i32) < 0 {
            return None;
        }
        self.first = (self.first + 1) % UNDER_WAY;
        self.count -= 1;
        Some(byte)
    }
}
