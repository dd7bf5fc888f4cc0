//! Datagrams byte for byte (data sheet, section 4.1), and their checksum (section 4.2).

use core::fmt;

use super::registers::Register;

/// First byte of every datagram: the nibble 1010, lowest bit first, by which the chip measures the
/// speed of the line.
const SYNC: u8 = 0x05;

/// Whom a reply is for.
const MASTER_ADDRESS: u8 = 0xff;

/// Bit of the register's byte that makes a write.
const WRITE: u8 = 0x80;

/// Bytes of a read request.
pub const READ_REQUEST_BYTES: usize = 4;

/// Bytes of a write request.
pub const WRITE_BYTES: usize = 8;

/// Bytes of a reply.
pub const REPLY_BYTES: usize = 8;

/// The checksum of section 4.2: polynomial x^8 + x^2 + x + 1, beginning with 0, lowest bit of
/// each byte first.
#[must_use]
pub fn crc8(bytes: &[u8]) -> u8 {
    // Computed mirrored, in the order of the bits: half a byte at a time.
    let half = |crc: u8| crc >> 4 ^ HALF_BYTES[usize::from(crc & 15)];
    bytes.iter().fold(0, |crc, byte| half(half(crc ^ byte))).reverse_bits()
}

/// The effect of the four bits that leave the mirrored checksum; 0xe0 is the
/// polynomial 0x07 mirrored.
const HALF_BYTES: [u8; 16] = {
    let mut table = [0; 16];
    let mut bits = 0;
    while bits < 16 {
        let (mut crc, mut shifts) = (bits as u8, 0);
        while shifts < 4 {
            crc = (crc >> 1) ^ ((crc & 1) * 0xe0);
            shifts += 1;
        }
        table[bits] = crc;
        bits += 1;
    }
    table
};

/// The datagram that writes a register of the chip at `address` (0 to 3): section 4.1.1.
#[must_use]
pub fn write_request(address: u8, register: Register, value: u32) -> [u8; WRITE_BYTES] {
    let [d3, d2, d1, d0] = value.to_be_bytes();
    let head = [SYNC, address, register.address() | WRITE, d3, d2, d1, d0];
    let [sync, address, register, ..] = head;
    [sync, address, register, d3, d2, d1, d0, crc8(&head)]
}

/// The datagram that asks the chip at `address` (0 to 3) for a register: section 4.1.2.
#[must_use]
pub fn read_request(address: u8, register: Register) -> [u8; READ_REQUEST_BYTES] {
    let head = [SYNC, address, register.address()];
    let [sync, address, register] = head;
    [sync, address, register, crc8(&head)]
}

/// Reason why bytes are not the expected reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplyError {
    /// The bytes are fewer than a reply has.
    Short {
        /// Number of bytes.
        received: usize,
    },
    /// The checksum is wrong.
    BadCrc {
        /// The checksum of the bytes before it.
        expected: u8,
        /// The received checksum.
        received: u8,
    },
    /// The first byte is not the synchronisation.
    WrongSync(u8),
    /// The reply has another address.
    WrongAddress(u8),
    /// The reply is of another register.
    WrongRegister(u8),
}

impl fmt::Display for ReplyError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short { received } => write!(out, "{received} of {REPLY_BYTES} bytes came"),
            Self::BadCrc { expected, received } => {
                write!(out, "its check sum is 0x{received:02x}, expected 0x{expected:02x}")
            }
            Self::WrongSync(byte) => write!(out, "it begins with 0x{byte:02x}, expected 0x{SYNC:02x}"),
            Self::WrongAddress(address) => {
                write!(out, "it is for address 0x{address:02x}, expected 0x{MASTER_ADDRESS:02x}")
            }
            Self::WrongRegister(register) => write!(out, "it is of register 0x{register:02x}"),
        }
    }
}

/// The value in a reply, which must be one of `register` (section 4.1.2). Bytes after its
/// eight are ignored.
///
/// # Errors
/// The bytes are not such a reply.
pub fn parse_reply(bytes: &[u8], register: Register) -> Result<u32, ReplyError> {
    let Some(&[sync, address, of, d3, d2, d1, d0, crc]) = bytes.first_chunk() else {
        return Err(ReplyError::Short { received: bytes.len() });
    };
    let expected = crc8(&[sync, address, of, d3, d2, d1, d0]);
    if crc != expected {
        return Err(ReplyError::BadCrc { expected, received: crc });
    }
    if sync != SYNC {
        return Err(ReplyError::WrongSync(sync));
    }
    if address != MASTER_ADDRESS {
        return Err(ReplyError::WrongAddress(address));
    }
    if of != register.address() {
        return Err(ReplyError::WrongRegister(of));
    }
    Ok(u32::from_be_bytes([d3, d2, d1, d0]))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    /// The formula of section 4.2 for a register of single bits, written down anew.
    fn crc_by_bits(bytes: &[u8]) -> u8 {
        let mut crc = [false; 8];
        for byte in bytes {
            for bit in 0..8 {
                let incoming = crc[7] ^ (byte >> bit & 1 == 1);
                crc = [incoming, crc[0] ^ incoming, crc[1] ^ incoming, crc[2], crc[3], crc[4], crc[5], crc[6]];
            }
        }
        crc.iter().rev().fold(0, |value, &bit| value << 1 | u8::from(bit))
    }

    #[test]
    fn check_sums_seen_on_a_real_line() {
        // A read of IOIN and the chip's reply, by a master that fills the upper nibble
        // of the first byte.
        assert_eq!(crc8(&[0x55, 0x00, 0x06]), 0xe8);
        assert_eq!(parse_reply(&[0x05, 0xff, 0x06, 0x21, 0x00, 0x02, 0x41, 0x9d], Register::Ioin), Ok(0x2100_0241));
        assert_eq!(read_request(0, Register::Gconf), [0x05, 0x00, 0x00, 0x48]);
        assert_eq!(read_request(0, Register::Ioin), [0x05, 0x00, 0x06, 0x6f]);
    }

    #[test]
    fn a_write_byte_for_byte() {
        let datagram = write_request(3, Register::IholdIrun, 0x0123_4567);
        assert_eq!(datagram[..7], [0x05, 0x03, 0x90, 0x01, 0x23, 0x45, 0x67]);
        assert_eq!(datagram[7], crc_by_bits(&datagram[..7]));
    }

    #[test]
    fn what_is_wrong_with_a_reply_is_told() {
        let reply = |head: [u8; 7]| {
            let mut bytes = [0; 8];
            bytes[..7].copy_from_slice(&head);
            bytes[7] = crc8(&head);
            bytes
        };
        let good = reply([0x05, 0xff, 0x02, 0, 0, 0, 7]);
        assert_eq!(parse_reply(&good, Register::Ifcnt), Ok(7));
        assert_eq!(parse_reply(&good[..7], Register::Ifcnt), Err(ReplyError::Short { received: 7 }));
        assert_eq!(parse_reply(&good, Register::Gstat), Err(ReplyError::WrongRegister(2)));
        let wrong = |head| parse_reply(&reply(head), Register::Ifcnt).unwrap_err();
        assert_eq!(wrong([0x05, 0x00, 0x02, 0, 0, 0, 7]), ReplyError::WrongAddress(0));
        assert_eq!(wrong([0x15, 0xff, 0x02, 0, 0, 0, 7]), ReplyError::WrongSync(0x15));
        let mut bad = good;
        bad[6] ^= 1;
        assert!(matches!(parse_reply(&bad, Register::Ifcnt), Err(ReplyError::BadCrc { .. })));
    }

    proptest! {
        #[test]
        fn the_check_sum_is_that_of_the_formula(bytes in proptest::collection::vec(any::<u8>(), 0..12)) {
            prop_assert_eq!(crc8(&bytes), crc_by_bits(&bytes));
        }

        #[test]
        fn a_reply_reads_back(value in any::<u32>(), index in 0..Register::ALL.len()) {
            let register = Register::ALL[index];
            let [d3, d2, d1, d0] = value.to_be_bytes();
            let mut bytes = [0x05, 0xff, register.address(), d3, d2, d1, d0, 0];
            bytes[7] = crc_by_bits(&bytes[..7]);
            prop_assert_eq!(parse_reply(&bytes, register), Ok(value));
            // No single wrong bit slips through.
            for bit in 0..64 {
                let mut damaged = bytes;
                damaged[bit / 8] ^= 1 << (bit % 8);
                prop_assert!(parse_reply(&damaged, register).is_err());
            }
        }

        #[test]
        fn garbage_is_accepted_only_with_a_right_check_sum(bytes in proptest::collection::vec(any::<u8>(), 0..12)) {
            if parse_reply(&bytes, Register::Ifcnt).is_ok() {
                prop_assert_eq!(bytes[7], crc_by_bits(&bytes[..7]));
                prop_assert_eq!(&bytes[..3], &[0x05, 0xff, 0x02]);
            }
        }
    }
}
