//! The square root itself.

#[cfg(all(target_arch = "arm", target_os = "none", target_abi = "eabihf"))]
// SAFETY: C's sqrtf takes and returns a float, and any float will do. Without an operating system
// it is that of the `compiler_builtins` crate, which is in every program.
unsafe extern "C" {
    safe fn sqrtf(x: f32) -> f32;
}

/// Square root of `x`; NaN below zero.
///
/// The compiler knows the function of C: it puts in the instruction, and calls only where that has
/// given NaN. An `asm!` block would take core registers only, and two moves each way.
#[cfg(all(target_arch = "arm", target_os = "none", target_abi = "eabihf"))]
#[inline]
pub fn square_root(x: f32) -> f32 {
    sqrtf(x)
}

/// Square root of `x`; NaN below zero.
#[cfg(not(all(target_arch = "arm", target_os = "none", target_abi = "eabihf")))]
#[inline]
pub fn square_root(x: f32) -> f32 {
    libm::sqrtf(x)
}

#[cfg(test)]
mod tests {
    use super::square_root;

    /// Correctly rounded: no neighbour is nearer. Products of two f32 are exact in f64, and of two
    /// half-way points too (25 bits each).
    fn is_nearest(x: f32, root: f32) -> bool {
        let below = (f64::from(root) + f64::from(root.next_down())) / 2.0;
        let above = (f64::from(root) + f64::from(root.next_up())) / 2.0;
        below * below < f64::from(x) && f64::from(x) < above * above
    }

    #[test]
    fn roots_are_correctly_rounded() {
        // Every exponent, and mantissas all over: a step prime to 2^32.
        let mut bits = 0u32;
        for _ in 0..4_000_000 {
            bits = bits.wrapping_add(2_654_435_769);
            let x = f32::from_bits(bits & 0x7fff_ffff);
            if x.is_normal() {
                assert!(is_nearest(x, square_root(x)), "{x:e}");
            }
        }
    }

    #[test]
    fn ends_of_the_range() {
        assert_eq!(square_root(0.0).to_bits(), 0);
        assert_eq!(square_root(f32::INFINITY), f32::INFINITY);
        assert!(square_root(-1.0).is_nan());
        assert!(square_root(f32::NAN).is_nan());
    }
}
