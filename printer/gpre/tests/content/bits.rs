//! A writer of bits without checks.

/// Bits, the most significant first.
#[derive(Clone, Debug, Default)]
pub struct Bits(Vec<bool>);

impl Bits {
    /// Adds the lowest bits of a number.
    pub fn put(&mut self, value: u64, count: u32) {
        self.0.extend((0..count).rev().map(|bit| value >> bit & 1 == 1));
    }

    /// Adds an f32.
    pub fn float(&mut self, value: f32) {
        self.put(value.to_bits().into(), 32);
    }

    /// Adds g(k): as many zeros as the number plus 2^k has bits beyond k + 1, then it.
    pub fn golomb(&mut self, value: u64, k: u32) {
        let coded = u128::from(value) + (1 << k);
        let width = 128 - coded.leading_zeros();
        self.0.extend((0..width - 1 - k).map(|_| false));
        self.0.extend((0..width).rev().map(|bit| coded >> bit & 1 == 1));
    }

    /// Adds s(k): 0, -1, 1, -2 ... as 0, 1, 2, 3 ...
    pub fn signed(&mut self, value: i64, k: u32) {
        self.golomb(if value < 0 { 2 * value.unsigned_abs() - 1 } else { 2 * value.unsigned_abs() }, k);
    }

    /// Number of bits.
    pub fn length(&self) -> usize {
        self.0.len()
    }

    /// The bits as bytes, the last one filled with zeros.
    pub fn into_bytes(self) -> Vec<u8> {
        self.0
            .chunks(8)
            .map(|bits| bits.iter().enumerate().fold(0, |byte, (index, bit)| byte | u8::from(*bit) << (7 - index)))
            .collect()
    }
}
