//! The arithmetic of a block in either precision (R5).
//!
//! The board's processor has f32 in hardware (an instruction each) and f64 in software (60 to
//! 600 instructions each). What is computed once a block is therefore written once, for both:
//! f32 where the block is short enough for it to be exact enough, f64 for long ones, whose many
//! steps share the cost.

use core::ops::{Add, Div, Mul, Sub};

use crate::square_root::{square_root, square_root_f32};

/// A floating-point type: + - * /, the square root, and conversions. All are correctly rounded
/// on every target.
pub trait Real:
    Copy + PartialOrd + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Zero.
    const ZERO: Self;

    /// The nearest value.
    fn from_u32(x: u32) -> Self;

    /// The nearest value, of a constant.
    fn constant(x: f64) -> Self;

    /// Converts exactly.
    fn from_f32(x: f32) -> Self;

    /// The square root; of a negative number zero (rounding can leave a tiny one).
    fn square_root(self) -> Self;

    /// Cut to a whole number; the nearest end of the range outside of it.
    fn to_u32(self) -> u32;

    /// Cut to a whole number; the nearest end of the range outside of it.
    fn to_u64(self) -> u64;

    /// The nearest f32.
    fn to_f32(self) -> f32;
}

/// 2^32.
const WORD: f32 = 4_294_967_296.0;

impl Real for f32 {
    const ZERO: Self = 0.0;

    #[inline]
    fn from_u32(x: u32) -> Self {
        x as Self
    }

    #[inline]
    fn constant(x: f64) -> Self {
        x as Self
    }

    #[inline]
    fn from_f32(x: f32) -> Self {
        x
    }

    #[inline]
    fn square_root(self) -> Self {
        if self > 0.0 { square_root_f32(self) } else { 0.0 }
    }

    #[inline]
    fn to_u32(self) -> u32 {
        self as u32
    }

    #[inline]
    fn to_u64(self) -> u64 {
        // Two halves, both exact: the processor converts to 32 bits only.
        let high = (self * (1.0 / WORD)) as u32;
        let low = (self - high as Self * WORD) as u32;
        u64::from(high) << 32 | u64::from(low)
    }

    #[inline]
    fn to_f32(self) -> f32 {
        self
    }
}

impl Real for f64 {
    const ZERO: Self = 0.0;

    #[inline]
    fn from_u32(x: u32) -> Self {
        Self::from(x)
    }

    #[inline]
    fn constant(x: f64) -> Self {
        x
    }

    #[inline]
    fn from_f32(x: f32) -> Self {
        Self::from(x)
    }

    #[inline]
    fn square_root(self) -> Self {
        square_root(self)
    }

    #[inline]
    fn to_u32(self) -> u32 {
        self as u32
    }

    #[inline]
    fn to_u64(self) -> u64 {
        self as u64
    }

    #[inline]
    fn to_f32(self) -> f32 {
        self as f32
    }
}

#[cfg(test)]
mod tests {
    use super::Real;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn f32_becomes_the_whole_number_below(bits in 0u32..0x7f80_0000) {
            let x = f32::from_bits(bits);
            prop_assert_eq!(Real::to_u64(x), x as u64);
            prop_assert_eq!(Real::to_u32(x), x as u32);
        }
    }

    #[test]
    fn beyond_the_range_is_its_end() {
        assert_eq!(Real::to_u64(f32::MAX), u64::MAX);
        assert_eq!(Real::to_u64(-1.0f32), 0);
        assert_eq!(Real::to_u64(f32::INFINITY), u64::MAX);
        assert_eq!(Real::to_u64(f32::NEG_INFINITY), 0);
        assert_eq!(Real::to_u64(f32::NAN), 0);
        assert_eq!(Real::to_u64(f64::MAX), u64::MAX);
    }
}
