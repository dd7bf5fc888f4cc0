//! Bit streams, most significant bit first, and short codes for numbers.

use crate::error::Fault;

/// Reads bits. Only the codes of moves are inlined, to save flash.
#[derive(Clone, Copy, Debug)]
pub struct BitReader<'a> {
    bytes: &'a [u8],
    /// Position of the next bit.
    position: usize,
}

/// The value of missing bits.
const OVER: Fault = Fault::Content("the end of the frame after its last item");

/// The number of bits that [`BitReader::window`] always shows.
const WINDOW_BITS: u32 = 25;

/// Order of an exponential Golomb code, in the form the reader uses.
#[derive(Clone, Copy, Debug)]
pub struct Order {
    /// Order plus one: the length of the shortest code, bits.
    shortest: u32,
    /// Difference between the code, read as a number, and the number that it encodes.
    base: u32,
}

impl Order {
    /// Code of order `k`, at most 31.
    pub fn new(k: u32) -> Self {
        let k = k & 31;
        Self { shortest: k + 1, base: 1 << k }
    }

    fn k(self) -> u32 {
        self.shortest.wrapping_sub(1)
    }
}

/// The next bits, most significant first, and how many of them certainly exist.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    bits: u32,
    valid: u32,
}

impl Window {
    /// First bits of the window as a number, at least 1 and at most 32.
    #[inline(always)]
    pub fn first(self, count: u32) -> u32 {
        self.bits >> (32_u32.wrapping_sub(count) & 31)
    }

    /// The window after its first bits, fewer than 25.
    #[inline(always)]
    pub fn behind(self, count: u32) -> Self {
        Self { bits: self.bits.wrapping_shl(count), valid: self.valid.wrapping_sub(count) }
    }
}

impl<'a> BitReader<'a> {
    /// Reader that starts at the first bit.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    /// Position of the next bit.
    pub fn position(&self) -> usize {
        self.position
    }

    /// Reader of the same bits that starts at another position.
    pub fn at(&self, position: usize) -> Self {
        Self { bytes: self.bytes, position }
    }

    /// Moves to the position of another reader of the same bits.
    #[inline(always)]
    pub fn go_to(&mut self, other: Self) {
        self.position = other.position;
    }

    /// The number of remaining bits.
    pub fn left(&self) -> usize {
        (8 * self.bytes.len()).saturating_sub(self.position)
    }

    /// The next bits, at least 25 of them; zeros after the end.
    #[inline(always)]
    pub fn window(&self) -> Window {
        let first = self.position / 8;
        let word = match self.bytes.get(first..first + 4) {
            Some(&[a, b, c, d]) => u32::from_be_bytes([a, b, c, d]),
            _ => window_at_end(self.bytes, first),
        };
        Window { bits: word << (self.position % 8), valid: WINDOW_BITS }
    }

    /// Skips some bits, at most 64, which may be missing: [`Self::checked`] reports that.
    #[inline(always)]
    pub fn pass_unchecked(&mut self, count: u32) {
        // A frame has 2048 bytes at most, and slices are far from 2^29.
        self.position = self.position.wrapping_add(count as usize);
    }

    /// Returns an error if the reader has passed the end of the bits.
    #[inline(always)]
    pub fn checked(&self) -> Result<(), Fault> {
        if self.position > self.bytes.len().wrapping_mul(8) { Err(OVER) } else { Ok(()) }
    }

    /// Skips some bits, at most 64.
    pub fn pass(&mut self, count: u32) -> Result<(), Fault> {
        self.pass_unchecked(count);
        self.checked()
    }

    /// The next bit.
    #[inline(never)]
    pub fn bit(&mut self) -> Result<bool, Fault> {
        let bit = self.window().first(1) != 0;
        self.pass(1)?;
        Ok(bit)
    }

    /// The next bits as a number, at most 25 of them.
    #[inline(never)]
    pub fn few(&mut self, count: u32) -> Result<u32, Fault> {
        let count = count.min(WINDOW_BITS);
        // Two shifts, because a shift by 32 overflows.
        let value = self.window().bits >> 1 >> (31 - count);
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

    /// A number in an exponential Golomb code of order `k`: n zeros, then n + 1 + k bits that begin
    /// with a one, the number plus 2^k.
    #[inline(never)]
    pub fn golomb(&mut self, k: u32) -> Result<u32, Fault> {
        let Some(number) = self.golomb_in(self.window(), Order::new(k)) else { return self.golomb_of_many(k) };
        self.checked()?;
        Ok(number)
    }

    /// Reads a number if the window has all its bits; [`Self::checked`] checks that they
    /// exist. Less than 2^25.
    #[inline(always)]
    fn golomb_in(&mut self, window: Window, order: Order) -> Option<u32> {
        let length = order.shortest.wrapping_add(2 * window.bits.leading_zeros());
        if length > window.valid {
            return None;
        }
        self.pass_unchecked(length);
        // Leading zeros do not change the value.
        Some(window.first(length).wrapping_sub(order.base))
    }

    #[cold]
    #[inline(never)]
    fn golomb_of_many(&mut self, k: u32) -> Result<u32, Fault> {
        u32::try_from(self.golomb_long(k)?).map_err(|_| Fault::Content("a number of at most 32 bits"))
    }

    /// Version of [`Self::golomb`] for up to 64 bits.
    fn golomb_long(&mut self, k: u32) -> Result<u64, Fault> {
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
    #[inline(never)]
    pub fn signed(&mut self, order: Order) -> Result<i32, Fault> {
        self.golomb(order.k()).map(with_sign)
    }

    /// Reads a number with a sign if the window has all its bits; [`Self::checked`] checks that
    /// they exist. At most 2^24 either way.
    #[inline(always)]
    pub fn signed_in(&mut self, window: Window, order: Order) -> Option<i32> {
        self.golomb_in(window, order).map(with_sign)
    }

    /// Version of [`Self::signed`] for up to 63 bits.
    pub fn signed_long(&mut self, k: u32) -> Result<i64, Fault> {
        let coded = self.golomb_long(k)?;
        Ok((coded >> 1) as i64 ^ -((coded & 1) as i64))
    }
}

/// 0, 1, 2, 3 ... as 0, -1, 1, -2 ...
#[inline(always)]
fn with_sign(coded: u32) -> i32 {
    (coded >> 1) as i32 ^ ((coded & 1) as i32).wrapping_neg()
}

/// Window near the end, where fewer than four bytes are left.
#[cold]
#[inline(never)]
fn window_at_end(bytes: &[u8], first: usize) -> u32 {
    let rest = bytes.get(first..).unwrap_or(&[]);
    (0..4).fold(0, |word, index| word << 8 | u32::from(rest.get(index).copied().unwrap_or(0)))
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

    /// Adds the lowest bits of a number, at most 64.
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

    /// Writes a number for [`BitReader::golomb`]; it must be below 2^62.
    pub fn golomb(&mut self, value: u64, k: u32) {
        let value = value + (1 << k);
        let width = 64 - value.leading_zeros();
        self.bits(0, width - 1 - k);
        self.bits(value, width);
    }

    /// Writes a number for [`BitReader::signed`].
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
                    prop_assert_eq!(i64::from(other.signed(Order::new(k)).unwrap()), value >> 1);
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
            while reader.signed(Order::new(k)).is_ok() {
                count += 1;
                prop_assert!(count <= 8 * bytes.len());
            }
        }
    }
}
