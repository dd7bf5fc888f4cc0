//! Division of 64-bit numbers by a constant, without the processor's help (R7).
//!
//! A Cortex-M4 divides 32 bits in hardware and 64 bits in some 250 instructions of software. A
//! precomputed reciprocal turns it into four multiplications.

/// A divisor of 64-bit numbers, with its reciprocals.
#[derive(Clone, Copy, Debug)]
pub struct Divisor {
    divisor: u64,
    /// (2^64 - 1) / divisor, truncated.
    reciprocal: u64,
    /// 2^[`SHORT_BITS`] / divisor, truncated; 0 if that exceeds 32 bits.
    short: u32,
}

/// Numbers of up to this many bits (most are) are divided by two multiplications instead of six.
const SHORT_BITS: u32 = 54;

impl Divisor {
    /// A divisor of at least 1; 0 is taken for 1.
    pub const fn new(divisor: u64) -> Self {
        let divisor = if divisor == 0 { 1 } else { divisor };
        let short = (1 << SHORT_BITS) / divisor;
        Self { divisor, reciprocal: u64::MAX / divisor, short: if short >> 32 == 0 { short as u32 } else { 0 } }
    }

    /// Quotient and remainder of `number`, at most 2^63.
    #[inline]
    pub const fn divide(self, number: u64) -> (u64, u64) {
        if self.short != 0 && number >> SHORT_BITS == 0 {
            // The part of number / divisor below 2^22 loses less than 2^-10 and the cut reciprocal
            // less than 1, so the quotient is right or at most two too small.
            let upper = number >> (SHORT_BITS - 32);
            let mut quotient = (upper.wrapping_mul(self.short as u64)) >> 32;
            let mut remainder = number.wrapping_sub(quotient.wrapping_mul(self.divisor));
            while remainder >= self.divisor {
                quotient = quotient.wrapping_add(1);
                remainder = remainder.wrapping_sub(self.divisor);
            }
            return (quotient, remainder);
        }
        // The reciprocal is below 2^64 / divisor by at most 1, so the quotient is right or one too
        // small.
        let quotient = high_product(number, self.reciprocal);
        let remainder = number - quotient * self.divisor;
        if remainder >= self.divisor { (quotient + 1, remainder - self.divisor) } else { (quotient, remainder) }
    }

    /// Quotient and remainder of a signed number, the remainder not negative.
    #[inline]
    pub const fn divide_floor(self, number: i64) -> (i64, u64) {
        if number >= 0 {
            let (quotient, remainder) = self.divide(number as u64);
            return (quotient as i64, remainder);
        }
        // Negative number, with n = -number: number = -q d - r = -(q + 1) d + (d - r).
        let (quotient, remainder) = self.divide(number.unsigned_abs());
        if remainder == 0 { (-(quotient as i64), 0) } else { (-(quotient as i64) - 1, self.divisor - remainder) }
    }
}

/// The upper 64 bits of a product.
#[inline]
const fn high_product(a: u64, b: u64) -> u64 {
    let (a_high, a_low) = (a >> 32, a & 0xFFFF_FFFF);
    let (b_high, b_low) = (b >> 32, b & 0xFFFF_FFFF);
    let middle = a_high * b_low + ((a_low * b_low) >> 32);
    let carried = a_low * b_high + (middle & 0xFFFF_FFFF);
    a_high * b_high + (middle >> 32) + (carried >> 32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn quotients_are_exact(
            number in any::<i64>(),
            divisor in prop_oneof![1u64..1000, 1u64..1 << 40, Just(10_000_000_000), Just(3_906_250_000), 1u64..1 << 62],
        ) {
            let magnitude = number.unsigned_abs();
            prop_assert_eq!(Divisor::new(divisor).divide(magnitude), (magnitude / divisor, magnitude % divisor));
            let signed = divisor as i64;
            let expected = (number.div_euclid(signed), number.rem_euclid(signed) as u64);
            prop_assert_eq!(Divisor::new(divisor).divide_floor(number), expected);
        }

        #[test]
        fn short_quotients_are_exact(
            number in prop_oneof![0u64..1 << 54, 0u64..1 << 33, (1 << 54) - 1000..(1u64 << 54) + 1000],
            divisor in prop_oneof![1u64 << 22..1 << 24, Just(10_000_000_000), Just(3_906_250_000), 1u64 << 22..1 << 54],
        ) {
            prop_assert_eq!(Divisor::new(divisor).divide(number), (number / divisor, number % divisor));
        }

        #[test]
        fn multiples_and_their_neighbours(quotient in 0u64..1 << 31, divisor in 1u64..1 << 32) {
            let product = quotient * divisor;
            for number in [product.saturating_sub(1), product, product + 1] {
                prop_assert_eq!(Divisor::new(divisor).divide(number), (number / divisor, number % divisor));
            }
        }
    }
}
