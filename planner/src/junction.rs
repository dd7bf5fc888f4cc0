//! Highest speed through a corner.

use crate::block::Speed;
use crate::kinematics::UNITS_PER_MM;
use crate::limits::{larger, smaller};
use crate::path::{Path, Turn};
use crate::square_root::square_root_f32;

/// Radius, units of 10 nm, of the arc that rounds the corner between two moves; infinite if they
/// are in line, 0 if they reverse or one of them has no length.
///
/// Yu 2019, fig. 2: the arc stays within `deviation_10nm` of the corner, R = delta cos(theta/2) /
/// (1 - cos(theta/2)), theta being the angle between the two directions. The arc must also fit: it
/// touches each move at R tan(theta/2) from the corner, which must not pass the move's middle, so R
/// <= (d/2) / tan(theta/2), d being the length of the shorter move.
///
/// With c = cos(theta/2), q = c^2 = (1 + cos theta)/2 and 1 - c = sin^2(theta) / (4 q (1 + c))
/// these are 4 delta q c (1 + c) / sin^2(theta) and d q / sin(theta): one root and one division.
pub fn radius_10nm(before: &Path, after: &Path, four_deviations_10nm: f32) -> f32 {
    if before.length <= 0.0 || after.length <= 0.0 {
        return 0.0;
    }
    let turn = Turn::between(before, after);
    let cosine_squared = turn.half_cosine_squared();
    if cosine_squared <= 0.0 {
        return 0.0;
    }
    let cosine = square_root_f32(cosine_squared);
    // Infinite if they are in line.
    let inverse = 1.0 / turn.sine;
    let ratio = cosine_squared * inverse;
    let shorter = if before.length < after.length { before.length } else { after.length };
    let fitting = shorter * ratio;
    let within_deviation = four_deviations_10nm * cosine * (1.0 + cosine) * ratio * inverse;
    if within_deviation < fitting { within_deviation } else { fitting }
}

/// Largest speed at which no axis changes its own speed at a corner by more than its limit:
/// |u_after - u_before| v <= limit, u being the share of the axis in the path. `per_limit` are the
/// reciprocals of the limits of X, Y, Z and the filament, s/mm, 0 for an axis without one. Both
/// paths have a length. Z also takes X's and Y's changes times the surface's slope along them.
#[inline(always)]
pub fn speed_of_jumps(before: &Path, after: &Path, per_limit: [f32; 4], slope: [f32; 2]) -> Speed {
    let [x, y, z, e] = Path::jumps(before, after);
    let [slope_x, slope_y] = slope;
    let z = z + (slope_x * x + slope_y * y);
    let [per_x, per_y, per_z, per_e] = per_limit;
    let strictest = larger(larger(x * per_x, y * per_y), larger(z * per_z, e * per_e));
    // The quotient is infinite without a jump, and the cast saturates.
    Speed((65_536.0 / strictest) as u32)
}

/// Acceleration on the arc of a corner, squared units of [`Speed`] per unit of 10 nm.
#[derive(Clone, Copy, Debug)]
pub struct CornerAcceleration(f32);

impl CornerAcceleration {
    /// No acceleration: such a corner is a stop.
    pub const ZERO: Self = Self(0.0);

    /// An acceleration, mm/s^2.
    #[inline(always)]
    pub fn of_mm_per_s2(acceleration: f32) -> Self {
        // 2^32 squared units of speed in one squared mm/s.
        const SCALE: f32 = 4_294_967_296.0 / UNITS_PER_MM as f32;
        Self(acceleration * SCALE)
    }

    /// The acceleration in mm/s^2, to single precision.
    pub fn mm_per_s2(self) -> f32 {
        const PER_MM_PER_S2: f32 = 4_294_967_296.0 / UNITS_PER_MM as f32;
        self.0 / PER_MM_PER_S2
    }

    /// True if the acceleration is above zero.
    pub fn is_some(self) -> bool {
        self.0 > 0.0
    }

    /// The smaller of two accelerations.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        Self(smaller(self.0, other.0))
    }

    /// Speed along an arc of this radius, v^2 = a R (Yu 2019).
    #[inline(always)]
    pub fn speed_along(self, radius_10nm: f32) -> Speed {
        // The square root can be NaN, for an infinite radius without acceleration; the cast turns
        // it into 0.
        Speed(square_root_f32(radius_10nm * self.0) as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A corner of this many radians between two moves, the first of 100 mm.
    fn corner(angle: f64, second_mm: f64) -> (Path, Path) {
        let units = second_mm * 1e5;
        let turned = [(angle.cos() * units).round() as i32, (angle.sin() * units).round() as i32, 0];
        (Path::along([10_000_000, 0, 0]), Path::along(turned))
    }

    fn radius_mm(angle: f64, second_mm: f64, deviation_mm: f64) -> f64 {
        let (before, after) = corner(angle, second_mm);
        f64::from(radius_10nm(&before, &after, (4.0 * deviation_mm * 1e5) as f32)) / 1e5
    }

    #[test]
    fn straight_on_is_unbounded_and_reversal_stops() {
        assert_eq!(radius_mm(0.0, 1.0, 0.1), f64::INFINITY);
        assert_eq!(radius_mm(core::f64::consts::PI, 1.0, 0.1), 0.0);
    }

    #[test]
    fn a_right_angle_of_long_moves_keeps_the_deviation() {
        let radius = radius_mm(core::f64::consts::FRAC_PI_2, 100.0, 0.1);
        // The arc's distance from the corner is R (1/cos(theta/2) - 1).
        assert!((radius * (2f64.sqrt() - 1.0) - 0.1).abs() < 1e-7);
    }

    proptest! {
        #[test]
        fn the_arc_stays_within_deviation_and_fits(angle in 0.001f64..3.1, second in 1.0f64..50.0, deviation in 0.001f64..1.0) {
            let radius = radius_mm(angle, second, deviation);
            let (before, after) = corner(angle, second);
            // The angle of the rounded vectors.
            let [x, y, _] = after.vector.map(f64::from);
            let angle = y.atan2(x);
            let rounded = 1.0 + 1e-6 + 1e-6 / angle;
            prop_assert!(radius * (1.0 / (angle / 2.0).cos() - 1.0) <= deviation * rounded);
            let shorter = f64::from(before.length.min(after.length)) / 1e5;
            prop_assert!(radius * (angle / 2.0).tan() <= shorter / 2.0 * rounded);
        }

        #[test]
        fn one_of_both_bounds_is_met(angle in 0.001f64..3.1, deviation in 0.001f64..1.0) {
            let radius = radius_mm(angle, 20.0, deviation);
            let (_, after) = corner(angle, 20.0);
            let [x, y, _] = after.vector.map(f64::from);
            let half = y.atan2(x) / 2.0;
            let expected = (deviation * half.cos() / (1.0 - half.cos())).min(10.0 / half.tan());
            prop_assert!((radius - expected).abs() <= (2e-6 + 1e-6 / half) * expected, "{} {}", radius, expected);
        }
    }
}
