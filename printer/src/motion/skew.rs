//! Axes that are not at right angles.
//!
//! What the G-code asks for are places in a space with right angles. Here they become places of
//! the axes, and back: above this border (coordinates, G92, arcs) all is asked for, below it
//! (limits, homing, the bed, motors) all is the axes'. The map is linear, so that straight
//! lines stay straight.

use ferrostep_planner::square_root::square_root_f32;

/// Value of a factor of 1: the processor takes the upper half of a product by itself.
const ONE: f64 = 4_294_967_296.0;

/// Deviation of the axes from their right angles. The same numbers as Marlin's and Klipper's: where
/// Y leans towards +X by 1 mm in 100 mm, XY is 0.01.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Skew {
    /// Tangents of the angles of XY, XZ and YZ, in units of 2^-32.
    pub factors: [i32; 3],
}

/// A length times a factor, rounded.
fn scaled(length_10nm: i64, factor: i64) -> i64 {
    // Lengths are below 2^30 and factors below 2^28.
    length_10nm.wrapping_mul(factor).wrapping_add(1 << 31) >> 32
}

impl Skew {
    /// Axes at right angles.
    pub const NONE: Self = Self { factors: [0; 3] };

    /// The greatest factor, either way. A machine whose axes are 3 degrees off is to be mended.
    pub const MAX_FACTOR: f32 = 0.05;

    /// The skew of these factors of XY, XZ and YZ; those beyond [`Self::MAX_FACTOR`]
    /// become that one.
    pub fn of_factors(factors: [f64; 3]) -> Self {
        Self { factors: factors.map(fixed) }
    }

    /// The factors of XY, XZ and YZ.
    pub fn factors(&self) -> [f64; 3] {
        self.factors.map(|factor| f64::from(factor) / ONE)
    }

    /// The factor of a plane by the lengths AC, BD and AD of a parallelogram, units of 10 nm, to
    /// seven decimals; `None` if no parallelogram has these lengths.
    ///
    /// Marlin's formula (`Configuration.h`, `XY_SKEW_FACTOR`): AB = sqrt(2 AC^2 + 2 BD^2 - 4 AD^2)
    /// / 2, and the factor is tan(pi/2 - acos(c)), c = (AC^2 - AB^2 - AD^2) / (2 AB AD). That is c
    /// / sqrt(1 - c^2), and c is (AC^2 - BD^2) / (4 AB AD).
    pub fn factor_of_diagonals(lengths_10nm: [u32; 3]) -> Option<f32> {
        let [ac, bd, ad] = lengths_10nm.map(|length| length as f32);
        let [longer, shorter, _] = lengths_10nm.map(i64::from);
        let ab_squared = (ac * ac + bd * bd) * 0.5 - ad * ad;
        if !(ab_squared > 0.0 && ad > 0.0) {
            return None;
        }
        let cosine = (longer - shorter) as f32 * (ac + bd) / (4.0 * square_root_f32(ab_squared) * ad);
        let sine_squared = 1.0 - cosine * cosine;
        if sine_squared > 0.0 { Some(cosine / square_root_f32(sine_squared)) } else { None }
    }

    /// Difference between the asked position of an axis and its own, units of 10 nm. It depends on
    /// the axes after it.
    #[inline(never)]
    pub(crate) fn ahead_10nm(&self, axis: usize, [_, y, z]: [i64; 3]) -> i64 {
        let [xy, xz, yz] = self.factors.map(i64::from);
        match axis {
            0 => scaled(y, xy).wrapping_add(scaled(z, xz.wrapping_sub(scaled(xy, yz)))),
            1 => scaled(z, yz),
            _ => 0,
        }
    }

    /// Position of the axes for an asked position, units of 10 nm.
    pub(crate) fn axes(&self, asked_10nm: [i64; 3]) -> [i64; 3] {
        let [x, y, z] = asked_10nm;
        [x.wrapping_sub(self.ahead_10nm(0, asked_10nm)), y.wrapping_sub(self.ahead_10nm(1, asked_10nm)), z]
    }

    /// Asked position for a position of the axes, units of 10 nm: undoes [`Self::axes`], exactly.
    pub(crate) fn asked(&self, axes_10nm: [i64; 3]) -> [i64; 3] {
        let [x, y, z] = axes_10nm;
        let y = y.wrapping_add(self.ahead_10nm(1, axes_10nm));
        [x.wrapping_add(self.ahead_10nm(0, [x, y, z])), y, z]
    }
}

/// A factor in units of 2^-32.
#[inline(never)]
pub(crate) fn fixed(factor: f64) -> i32 {
    const MOST: i32 = (Skew::MAX_FACTOR as f64 * ONE) as i32;
    ((factor * ONE) as i32).clamp(-MOST, MOST)
}
