//! 64-bit integers to single precision: the bits of `as f32`, for which the target has no
//! instruction (R7).

/// The nearest single-precision number, the even one of two.
#[inline]
pub(crate) fn of_u64(value: u64) -> f32 {
    let high = (value >> 32) as u32;
    if high == 0 {
        return value as u32 as f32;
    }
    // The upper 32 bits that count, and whether any below them is set: the processor
    // rounds them to 24.
    let low = value as u32;
    let zeros = high.leading_zeros();
    // Two shifts, because a shift by 32 overflows.
    let upper = high.wrapping_shl(zeros) | (low >> 1).wrapping_shr(31_u32.wrapping_sub(zeros));
    let rest = u32::from(low.wrapping_shl(zeros) != 0);
    // 2^(32 - zeros); the product is exact.
    (upper | rest) as f32 * f32::from_bits(((127 + 32_u32).wrapping_sub(zeros)) << 23)
}

/// Version of [`of_u64`] for a number with a sign.
#[inline]
pub(crate) fn of_i64(value: i64) -> f32 {
    let magnitude = of_u64(value.unsigned_abs());
    if value < 0 { -magnitude } else { magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bits_are_those_of_the_language(value: u64, shift in 0u32..64, near in -2i64..3) {
            for value in [value >> shift, (value >> shift | 1 << 40) & !((1 << 16) - 1), (1u64 << shift).wrapping_add_signed(near)] {
                prop_assert_eq!(of_u64(value).to_bits(), (value as f32).to_bits(), "{}", value);
                let signed = value as i64;
                prop_assert_eq!(of_i64(signed).to_bits(), (signed as f32).to_bits(), "{}", signed);
            }
        }
    }
}
