//! The square root of f32 and f64, correctly rounded on every target.
//!
//! `core` has no stable one. f32 has its own crate with the processor's instruction; f64 is libm's
//! exact algorithm, so that both give the same bits everywhere.

/// Square root of `x`; of a negative number zero (rounding can leave a tiny one).
#[inline]
pub fn square_root(x: f64) -> f64 {
    if x > 0.0 { libm::sqrt(x) } else { 0.0 }
}

/// Square root of `x`, which is not negative.
#[inline]
pub fn square_root_f32(x: f32) -> f32 {
    // The absolute value tells the compiler that the root is not a NaN, so it does not check.
    ferrostep_square_root::square_root(x.abs())
}
