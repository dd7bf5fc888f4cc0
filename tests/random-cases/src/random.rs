//! Random numbers for searches that are longer than a property test's, the same everywhere.

/// Marsaglia's xorshift; its state, which is never 0.
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// Separate numbers for each case of a search.
    pub fn numbered(case: u64) -> Self {
        Self((case + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// Returns a number in 0..1.
    pub fn share(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a number in a range, every magnitude as likely as the others.
    pub fn magnitude(&mut self, from: f64, to: f64) -> f64 {
        from * (to / from).powf(self.share())
    }
}
