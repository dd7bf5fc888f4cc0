//! Trait for machines whose motors are sums of axes.

use core::num::Wrapping;
use core::ops::{Add, Sub};

/// A number that positions are computed with: exact integers where steps are made, floats where
/// speeds are compared.
pub trait Length: Copy + Add<Output = Self> + Sub<Output = Self> {
    /// Half of the value; integers are rounded towards zero.
    fn half(self) -> Self;
}

/// Units of 10 nm of positions within [`super::MAX_COORDINATE_10NM`]: sums of two are below 2^30
/// and need no check.
impl Length for Wrapping<i32> {
    fn half(self) -> Self {
        Wrapping(self.0 / 2)
    }
}

/// Fractions of steps, within 2^62.
impl Length for Wrapping<i64> {
    fn half(self) -> Self {
        Wrapping(self.0 / 2)
    }
}

impl Length for i64 {
    fn half(self) -> Self {
        self / 2
    }
}

impl Length for f32 {
    fn half(self) -> Self {
        self * 0.5
    }
}

impl Length for f64 {
    fn half(self) -> Self {
        self * 0.5
    }
}

// ANCHOR: trait
/// A machine whose motors X, Y and Z (as the board names them) are each at a sum or difference of
/// axes. All numbers of one call have one unit of length.
///
/// Both functions are linear, without constants and with integer factors from axes to motors. The
/// planner relies on this: a straight move at constant speed turns every motor at constant speed,
/// so that one step Bresenham per block makes the steps of all three, blocks merge by adding steps,
/// and a prepared job holds motor steps. A motor's steps are its coordinate times its steps/mm,
/// exactly rounded.
///
/// A delta is not such a machine: each of its motors would need a stepper that solves for the times
/// of its steps over the pieces of the path, and a prepared job would have to hold positions as
/// well.
pub trait LinearKinematics {
    /// Name in the profile and the trace.
    const NAME: &'static str;
    /// Name reported by M115.
    const REPORTED: &'static str;
    /// Letters of the motors that the board names X, Y and Z.
    const MOTORS: [char; 3];

    /// Motor positions X, Y, Z for a position.
    fn motors<T: Length>(position: [T; 3]) -> [T; 3];

    /// Position for these motor positions, the inverse of [`Self::motors`].
    fn position<T: Length>(motors: [T; 3]) -> [T; 3];
}
// ANCHOR_END: trait
