//! Bits, the most significant first, and numbers in few of them.

use crate::error::Fault;

/// Reads bits. What a move is made of is inlined, what is rare is not: flash is short.
#[derive(Clone, Copy, Debug)]
pub struct BitReader<'a> {
    bytes: &'a [u8],
    /// The next bit.
    position: usize,
}

/// What stands where bits are missing.
const OVER: Fault = Fault::Content("the end of the frame after its last item");

/// Most bits that [`BitReader::window`] shows for certain.
const WINDOW_BITS: u32 = 25;

impl<'a> BitReader<'a> {
    /// From the first bit on.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    /// The next bit's place.
    pub fn position(&self) -> usize {
        self.position
    }

    /// The same bits from another place on.
    pub fn at(&self, position: usize) -> Self {
        Self { bytes: self.bytes, position }
    }

    /// Bits that are left.
    pub fn left(&self) -> usize {
        (8 * self.bytes.len()).saturating_sub(self.position)
    }

    /// The next bits, from the most significant on, [`WINDOW_BITS`] of them at least; zeros behind the end.
    #[inline(always)]
    fn window(&self) -> u32 {
        let first = self.position / 8;
        let word = match self.bytes.get(first..first + 4) {
            Some(&[a, b, c, d]) => u32::from_be_bytes([a, b, c, d]),
            _ => self.window_at_end(first),
        };
        word << (self.position % 8)
    }

    #[cold]
    fn window_at_end(&self, first: usize) -> u32 {
        let rest = self.bytes.get(first..).unwrap_or(&[]);
        (0..4).fold(0, |word, index| word << 8 | u32::from(rest.get(index).copied().unwrap_or(0)))
    }

    /// The next two to four bits, at least, at the top of a word; to be passed by [`Self::pass`].
    #[inline]
    pub fn look(&self) -> u32 {
        self.window()
    }

    /// Passes some bits, at most 64.
    #[inline(always)]
    pub fn pass(&mut self, count: u32) -> Result<(), Fault> {
        // A frame has 2048 bytes at most, and slices are far from 2^29.
        let position = self.position.wrapping_add(count as usize);
        if position > self.bytes.len().wrapping_mul(8) {
            return Err(OVER);
        }
        self.position = position;
        Ok(())
    }

    /// The next bit.
    #[inline(never)]
    pub fn bit(&mut self) -> Result<bool, Fault> {
        let bit = self.window() >> 31 != 0;
        self.pass(1)?;
        Ok(bit)
    }

    /// The next bits as a number, at most 25 of them.
    #[inline(never)]
    pub fn few(&mut self, count: u32) -> Result<u32, Fault> {
        let count = count.min(WINDOW_BITS);
        // In two shifts: by 32 there is none.
        let value = self.window() >> 1 >> (31 - count);
        self.pass(count)?;
        Ok(value)
    }

    /// The next bits as a number, at most 64.
    pub fn many(&mut self, count: u32) -> Result<u64, Fault> {
        let mut left = count.min(64);
        let mut value = 0;
        while left > 0 {
            let some = left.min(16);
            value = value << some | u64::from(self.few(some)?);
            left -= some;
        }
        Ok(value)
    }

    /// A number in an exponential Golomb code of order `k`: n zeros, then n + 1 + k bits that begin with a one, the number
    /// plus 2^k.
    #[inline(never)]
    pub fn golomb(&mut self, k: u32) -> Result<u32, Fault> {
        self.golomb_at_once(k)
    }

    /// The same, where it is a part of every move.
    #[inline(always)]
    fn golomb_at_once(&mut self, k: u32) -> Result<u32, Fault> {
        let k = k & 31;
        let window = self.window();
        let zeros = window.leading_zeros();
        // 32 zeros and an order of 31 are 96 bits.
        let length = (2 * zeros + 1).wrapping_add(k);
        if length <= WINDOW_BITS {
            self.pass(length)?;
            // At least the one is there, so this is less than 32 places.
            let shift = 31_u32.wrapping_sub(zeros).wrapping_sub(k);
            return Ok(window.wrapping_shl(zeros).wrapping_shr(shift).wrapping_sub(1 << k));
        }
        self.golomb_of_many(k)
    }

    #[cold]
    fn golomb_of_many(&mut self, k: u32) -> Result<u32, Fault> {
        u32::try_from(self.golomb_long(k)?).map_err(|_| Fault::Content("a number of at most 32 bits"))
    }

    /// As [`Self::golomb`], of up to 64 bits.
    pub fn golomb_long(&mut self, k: u32) -> Result<u64, Fault> {
        const TOO_LONG: Fault = Fault::Content("a number of at most 63 bits");
        let k = k.min(32);
        let mut zeros = 0;
        while !self.bit()? {
            zeros += 1;
            if zeros + k > 62 {
                return Err(TOO_LONG);
            }
        }
        let below = self.many(zeros + k)?;
        Ok((1u64 << (zeros + k) | below) - (1u64 << k))
    }

    /// A number with a sign: 0, -1, 1, -2 ... as 0, 1, 2, 3 ...
    #[inline(always)]
    pub fn signed(&mut self, k: u32) -> Result<i32, Fault> {
        let coded = self.golomb_at_once(k)?;
        Ok((coded >> 1) as i32 ^ -((coded & 1) as i32))
    }

    /// As [`Self::signed`], of up to 63 bits.
    pub fn signed_long(&mut self, k: u32) -> Result<i64, Fault> {
        let coded = self.golomb_long(k)?;
        Ok((coded >> 1) as i64 ^ -((coded & 1) as i64))
    }
}

/// Writes bits.
#[cfg(feature = "write")]
#[derive(Clone, Debug, Default)]
pub struct BitWriter {
    bytes: std::vec::Vec<u8>,
    length: usize,
}

#[cfg(feature = "write")]
impl BitWriter {
    /// Bits so far.
    pub fn length(&self) -> usize {
        self.length
    }

    /// All bits, the last byte filled with zeros.
    pub fn into_bytes(self) -> std::vec::Vec<u8> {
        self.bytes
    }

    /// The lowest bits of a number, at most 64.
    pub fn bits(&mut self, value: u64, count: u32) {
        for index in (0..count).rev() {
            if self.length.is_multiple_of(8) {
                self.bytes.push(0);
            }
            if let Some(last) = self.bytes.last_mut() {
                *last |= ((value >> index & 1) as u8) << (7 - self.length % 8);
            }
            self.length += 1;
        }
    }

    /// See [`BitReader::golomb`]; the number is below 2^62.
    pub fn golomb(&mut self, value: u64, k: u32) {
        let value = value + (1 << k);
        let width = 64 - value.leading_zeros();
        self.bits(0, width - 1 - k);
        self.bits(value, width);
    }

    /// See [`BitReader::signed`].
    pub fn signed(&mut self, value: i64, k: u32) {
        self.golomb(zigzag(value), k);
    }
}

/// 0, -1, 1, -2 ... as 0, 1, 2, 3 ...
#[cfg(feature = "write")]
pub fn zigzag(value: i64) -> u64 {
    (value << 1 ^ value >> 63).cast_unsigned()
}

/// Length of a number in [`BitWriter::golomb`].
#[cfg(feature = "write")]
pub fn golomb_bits(value: u64, k: u32) -> u32 {
    let width = 64 - (value + (1 << k)).leading_zeros();
    2 * width - 1 - k
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_come_back(
            numbers in proptest::collection::vec((any::<i64>().prop_map(|x| x >> 2), 0u32..62, 0u32..25), 1..40),
        ) {
            let mut writer = BitWriter::default();
            for &(value, shift, k) in &numbers {
                let value = value >> shift;
                let before = writer.length();
                writer.golomb(value.unsigned_abs() & ((1 << 61) - 1), k);
                prop_assert_eq!(writer.length() - before, golomb_bits(value.unsigned_abs() & ((1 << 61) - 1), k) as usize);
                writer.signed(value >> 1, k);
                writer.bits(value as u64, 25);
            }
            let length = writer.length();
            let bytes = writer.into_bytes();
            let mut reader = BitReader::new(&bytes);
            for &(value, shift, k) in &numbers {
                let value = value >> shift;
                let coded = value.unsigned_abs() & ((1 << 61) - 1);
                let short = u32::try_from(coded);
                if let Ok(short) = short {
                    let mut other = reader;
                    prop_assert_eq!(other.golomb(k).unwrap(), short);
                }
                prop_assert_eq!(reader.golomb_long(k).unwrap(), coded);
                if i32::try_from(value >> 1).is_ok() {
                    let mut other = reader;
                    prop_assert_eq!(i64::from(other.signed(k).unwrap()), value >> 1);
                }
                prop_assert_eq!(reader.signed_long(k).unwrap(), value >> 1);
                prop_assert_eq!(u64::from(reader.few(25).unwrap()), value as u64 & 0x1ff_ffff);
            }
            prop_assert_eq!(reader.position(), length);
        }

        #[test]
        fn any_bytes_end_in_time(bytes in proptest::collection::vec(any::<u8>(), 0..60), k in 0u32..40) {
            let mut reader = BitReader::new(&bytes);
            let mut count = 0;
            while reader.signed(k).is_ok() {
                count += 1;
                prop_assert!(count <= 8 * bytes.len());
            }
        }
    }
}
