//! Datagrams on the driver's serial line (data sheet 4.1 to 4.3), byte by byte.

/// The first nibble of each datagram (4.1.1).
const SYNC_NIBBLE: u8 = 0x5;
/// The address in each reply: the master's (4.1.2).
const MASTER_ADDRESS: u8 = 0xFF;
/// Maximum bit times between two start bits of a datagram (4.1.1).
const MAX_GAP_BITS: u64 = 63;
/// Bit times of silence that a receiver needs after an error (4.1.1).
const RECOVERY_BITS: u64 = 12;
/// Bit times of one byte: start bit, eight data bits, stop bit.
pub const BYTE_BITS: u64 = 10;

/// The checksum of a datagram: polynomial x^8 + x^2 + x + 1, start value 0, each byte's lowest
/// bit first (4.2).
pub fn checksum(bytes: &[u8]) -> u8 {
    let mut crc = 0_u8;
    for &byte in bytes {
        let mut rest = byte;
        for _ in 0..8 {
            let feedback = (crc >> 7) ^ (rest & 1);
            crc <<= 1;
            if feedback == 1 {
                crc ^= 0x07;
            }
            rest >>= 1;
        }
    }
    crc
}

/// A datagram with a correct checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Datagram {
    /// A request to read a register.
    Read {
        /// The address of the driver.
        node: u8,
        /// The register, 0 to 0x7F.
        register: u8,
    },
    /// A value for a register.
    Write {
        /// The address of the driver.
        node: u8,
        /// The register, 0 to 0x7F.
        register: u8,
        /// The value.
        value: u32,
    },
}

/// A driver's reply to a read request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Reply {
    /// Start of its first start bit.
    pub start_ns: u64,
    /// The length of a bit: the requester's.
    pub bit_ns: u64,
    /// The reply's bytes, checksum included.
    pub bytes: [u8; 8],
}

impl Reply {
    /// A reply with this register's value.
    pub fn new(start_ns: u64, bit_ns: u64, register: u8, value: u32) -> Self {
        let [high, second, third, low] = value.to_be_bytes();
        let mut bytes = [SYNC_NIBBLE, MASTER_ADDRESS, register & 0x7F, high, second, third, low, 0];
        bytes[7] = checksum(&bytes[..7]);
        Self { start_ns, bit_ns, bytes }
    }

    /// End of its last stop bit.
    pub fn end_ns(&self) -> u64 {
        self.start_ns + self.bytes.len() as u64 * BYTE_BITS * self.bit_ns
    }
}

/// Assembles bytes into datagrams and recovers after errors.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Receiver {
    bytes: [u8; 8],
    count: u8,
    /// Length of a bit, measured at the sync nibble.
    bit_ns: u64,
    /// Start of the latest byte's start bit.
    newest_start_ns: u64,
    /// Last instant at which the line was busy, after an error.
    busy_until_ns: Option<u64>,
    /// Number of refused datagrams and bytes.
    errors: u32,
}

impl Receiver {
    /// True if a byte that starts now would be the first of a datagram, whose sync nibble
    /// sets the bit time.
    pub fn expects_sync(&self, start_ns: u64) -> bool {
        self.count == 0 || self.gap_too_long(start_ns)
    }

    /// The number of refusals: wrong sync nibble, wrong checksum, garbled byte.
    pub fn errors(&self) -> u32 {
        self.errors
    }

    /// Receives a byte whose start bit began at `start_ns`; returns the datagram that it completes,
    /// for any address.
    pub fn byte(&mut self, start_ns: u64, bit_ns: u64, byte: u8) -> Option<Datagram> {
        let end_ns = start_ns + BYTE_BITS * bit_ns;
        if let Some(busy_until_ns) = self.busy_until_ns {
            if start_ns.saturating_sub(busy_until_ns) < RECOVERY_BITS * bit_ns {
                self.busy_until_ns = Some(end_ns);
                return None;
            }
            self.busy_until_ns = None;
        }
        if self.gap_too_long(start_ns) {
            self.count = 0;
        }
        if self.count == 0 {
            self.bit_ns = bit_ns;
        }
        // Sampling in the middle of a bit reaches the stop bit at a baud rate within 5 %.
        let off = self.bit_ns.abs_diff(bit_ns);
        if off * 20 > self.bit_ns || (self.count == 0 && byte & 0x0F != SYNC_NIBBLE) {
            return self.fail(end_ns);
        }
        self.newest_start_ns = start_ns;
        self.bytes[usize::from(self.count)] = byte;
        self.count += 1;
        let length = if self.count >= 3 && self.bytes[2] & 0x80 == 0 { 4 } else { 8 };
        if self.count < length {
            return None;
        }
        let last = usize::from(length) - 1;
        if checksum(&self.bytes[..last]) != self.bytes[last] {
            return self.fail(end_ns);
        }
        self.count = 0;
        let [_, node, register, high, second, third, low, _] = self.bytes;
        Some(match register & 0x80 {
            0 => Datagram::Read { node, register },
            _ => {
                let value = u32::from_be_bytes([high, second, third, low]);
                Datagram::Write { node, register: register & 0x7F, value }
            }
        })
    }

    /// Reports activity that is not a byte: a missing stop bit, a bit time out of range. The line
    /// was busy until `end_ns`.
    pub fn garbled(&mut self, end_ns: u64) {
        self.fail(end_ns);
    }

    /// Discards an incomplete datagram, as at power-up.
    pub fn reset(&mut self) {
        (self.count, self.busy_until_ns) = (0, None);
    }

    fn gap_too_long(&self, start_ns: u64) -> bool {
        start_ns.saturating_sub(self.newest_start_ns) > MAX_GAP_BITS * self.bit_ns
    }

    fn fail(&mut self, end_ns: u64) -> Option<Datagram> {
        self.count = 0;
        self.errors = self.errors.saturating_add(1);
        self.busy_until_ns = Some(end_ns);
        None
    }
}
