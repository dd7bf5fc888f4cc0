//! A serial line that damages bits, the same ones in every run.

/// Flips one bit in about one line of a hundred.
#[derive(Clone, Debug)]
pub struct Noise {
    state: u64,
    corrupted: u32,
}

impl Noise {
    /// Average number of lines per damaged one.
    const ONE_IN: u64 = 100;

    /// Noise that depends on `seed` only.
    pub fn new(seed: u64) -> Self {
        Self { state: seed, corrupted: 0 }
    }

    /// The number of damaged lines so far.
    pub fn corrupted(&self) -> u32 {
        self.corrupted
    }

    /// Flips a bit of some lines, never in the last byte, the line end: a printer that misses it
    /// has nothing to answer, and only the host's patience helps.
    pub fn pass(&mut self, line: &mut [u8]) {
        let length = line.len().saturating_sub(1);
        if !self.next().is_multiple_of(Self::ONE_IN) {
            return;
        }
        let (place, bit) = (self.next(), self.next() % 8);
        let Some(place) = place.checked_rem(length as u64) else { return };
        if let Some(byte) = line.get_mut(place as usize) {
            *byte ^= 1 << bit;
            self.corrupted += 1;
        }
    }

    /// SplitMix64 (Steele, Lea, Flood 2014).
    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.state;
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_matches_its_publication() {
        let mut noise = Noise::new(1_234_567);
        let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        assert_eq!(expected.map(|_| noise.next()), expected);
    }

    #[test]
    fn about_one_line_in_a_hundred_differs_in_one_bit() {
        let mut noise = Noise::new(1);
        let mut changed = 0;
        for _ in 0..10_000 {
            let mut line = *b"N12 G1 X5.25*33\n";
            noise.pass(&mut line);
            let bits: u32 = line.iter().zip(b"N12 G1 X5.25*33\n").map(|(a, b)| (a ^ b).count_ones()).sum();
            assert!(bits <= 1);
            assert_eq!(line.last(), Some(&b'\n'));
            changed += bits;
        }
        assert_eq!(changed, noise.corrupted());
        assert!((60..150).contains(&changed), "{changed}");
    }

    #[test]
    fn a_line_without_content_passes() {
        let mut noise = Noise::new(2);
        for _ in 0..1000 {
            noise.pass(&mut []);
            noise.pass(&mut b"\n".clone());
        }
        assert_eq!(noise.corrupted(), 0);
    }
}
