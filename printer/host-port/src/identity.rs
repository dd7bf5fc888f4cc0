//! Identification of the device.

/// The open-source vendor of <https://pid.codes>.
pub const VENDOR_ID: u16 = 0x1209;

/// The first of pid.codes' numbers for tests, <https://pid.codes/1209/0001>: for development, not
/// for a product. A board maker requests another number there, which is granted to open-source
/// projects, and puts it here.
pub const PRODUCT_ID: u16 = 0x0001;

/// The manufacturer's string.
pub const MANUFACTURER: &str = "Ferrostep";

/// Hexadecimal digits of the 96-bit identifier.
const DIGITS: usize = 24;

/// Serial number of a board: its chip's unique identifier, by which a host recognises the printer
/// at any port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialNumber([u8; DIGITS]);

impl SerialNumber {
    /// Serial number from the three words of the identifier, in the order of their addresses; eight
    /// digits each.
    pub fn of(words: [u32; 3]) -> Self {
        let mut digits = [0; DIGITS];
        let nibbles = words.iter().flat_map(|word| (0..8).rev().map(move |place| word >> (4 * place) & 0xf));
        for (digit, nibble) in digits.iter_mut().zip(nibbles) {
            *digit = b"0123456789ABCDEF".get(nibble as usize).copied().unwrap_or(b'0');
        }
        Self(digits)
    }

    /// The serial number as a string.
    pub fn as_str(&self) -> &str {
        // Digits are ASCII.
        core::str::from_utf8(&self.0).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_digit_of_the_identifier_is_in_the_serial_number() {
        assert_eq!(SerialNumber::of([0x0123_4567, 0x89ab_cdef, 0xfedc_ba98]).as_str(), "0123456789ABCDEFFEDCBA98");
        assert_eq!(SerialNumber::of([0, 1, u32::MAX]).as_str(), "0000000000000001FFFFFFFF");
    }
}
