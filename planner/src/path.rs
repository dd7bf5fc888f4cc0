//! The straight path of a move, and its length.
//!
//! Lengths and angles are in single precision: of 84 mm 10 nm are known then, and of an angle 0.3
//! microradians, at which a corner allows more than any feed.

use crate::square_root::square_root_f32;

/// The path of X, Y and Z from one machine position to another, units of 10 nm.
#[derive(Clone, Copy, Debug)]
pub struct Path {
    /// The components, to single precision.
    pub vector: [f32; 3],
    /// The length.
    pub length: f32,
    /// Filament that is pushed along it, below zero where it is drawn back, units of 10 nm.
    pub filament: f32,
}

impl Path {
    /// No path.
    pub const NONE: Self = Self { vector: [0.0; 3], length: 0.0, filament: 0.0 };

    /// The path along a vector whose components are at most twice
    /// [`crate::kinematics::MAX_COORDINATE_10NM`] either way.
    #[inline(always)]
    pub fn along(vector_10nm: [i32; 3]) -> Self {
        let vector = vector_10nm.map(|component| component as f32);
        Self { vector, length: square_root_f32(dot(vector, vector)), filament: 0.0 }
    }

    /// Path of the same direction with this length, in units of 10 nm; 0 keeps the length.
    pub fn of_length(&self, length: f32) -> Self {
        if length <= 0.0 || self.length <= 0.0 {
            return *self;
        }
        let factor = length / self.length;
        Self { vector: self.vector.map(|component| component * factor), length, filament: self.filament * factor }
    }

    /// Differences between the speeds of X, Y, Z and the filament on two paths that have a length,
    /// for a unit of speed along them.
    #[inline(always)]
    pub fn jumps(before: &Self, after: &Self) -> [f32; 4] {
        let ([ax, ay, az], [bx, by, bz]) = (before.vector, after.vector);
        let (per_before, per_after) = (1.0 / before.length, 1.0 / after.length);
        let jump = |before: f32, after: f32| (after * per_after - before * per_before).abs();
        [jump(ax, bx), jump(ay, by), jump(az, bz), jump(before.filament, after.filament)]
    }

    /// The length in whole units.
    #[inline(always)]
    pub fn length_10nm(&self) -> u32 {
        (self.length + 0.5) as u32
    }
}

/// The scalar product. Components of zero change no bit of it.
#[inline(always)]
fn dot([ax, ay, az]: [f32; 3], [bx, by, bz]: [f32; 3]) -> f32 {
    ax * bx + ay * by + az * bz
}

/// Angle between a path and the next.
#[derive(Clone, Copy, Debug)]
pub struct Turn {
    /// Cosine of the angle.
    pub cosine: f32,
    /// Sine of the angle, not below zero.
    pub sine: f32,
}

impl Turn {
    /// cos = a b / |a||b| and sin = |a x b| / |a||b|, of two paths that have a length.
    pub fn between(before: &Path, after: &Path) -> Self {
        let ([ax, ay, az], [bx, by, bz]) = (before.vector, after.vector);
        let inverse = 1.0 / (before.length * after.length);
        let [x, y, z] = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx].map(|cross| cross * inverse);
        let sine = if x == 0.0 && y == 0.0 { z.abs() } else { square_root_f32(x * x + y * y + z * z) };
        Self { cosine: dot(before.vector, after.vector) * inverse, sine }
    }

    /// Squared cosine of half the angle; precise for turns back as well.
    #[inline(always)]
    pub fn half_cosine_squared(self) -> f32 {
        if self.cosine < 0.0 {
            // (1 + cos)(1 - cos) = sin^2, and nothing cancels.
            return 0.5 * self.sine * self.sine / (1.0 - self.cosine);
        }
        0.5 * (1.0 + self.cosine)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    fn coordinate() -> impl Strategy<Value = i32> {
        prop_oneof![-30i32..30, -100_000i32..100_000, -30_000_000i32..30_000_000, -500_000_000i32..=500_000_000]
    }

    proptest! {
        #[test]
        fn lengths_have_single_precision(
            from in proptest::array::uniform3(coordinate()), to in proptest::array::uniform3(coordinate()),
        ) {
            let path = Path::along([to[0] - from[0], to[1] - from[1], to[2] - from[2]]);
            let exact = from.iter().zip(to).map(|(from, to)| f64::from(to - from).powi(2)).sum::<f64>().sqrt();
            prop_assert!((f64::from(path.length) - exact).abs() <= 1.8e-7 * exact);
            prop_assert!((f64::from(path.length_10nm()) - exact).abs() <= 0.5 + 2.4e-7 * exact);
        }

        #[test]
        fn turns_have_single_precision(
            a in proptest::array::uniform3(coordinate()), b in proptest::array::uniform3(coordinate()),
            turn in prop_oneof![Just(None), (-1_000i32..1_000).prop_map(Some)], flat in any::<bool>(),
        ) {
            // Includes paths nearly in line, there and back.
            let mut b = match turn {
                Some(turn) if turn % 2 == 0 => [a[0] + turn, a[1] - turn, a[2] + turn / 3],
                Some(turn) => [turn - a[0], -turn - a[1], turn / 3 - a[2]],
                None => b,
            };
            let mut a = a;
            if flat {
                (a[2], b[2]) = (0, 0);
            }
            prop_assume!(a != [0; 3] && b != [0; 3]);
            let (one, other) = (Path::along(a), Path::along(b));
            let found = Turn::between(&one, &other);
            let (a, b) = (a.map(f64::from), b.map(f64::from));
            let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
            let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
            let angle = length(cross).atan2(a.iter().zip(b).map(|(a, b)| a * b).sum());
            prop_assert!((f64::from(found.cosine) - angle.cos()).abs() <= 5e-7, "{:?} {}", found, angle);
            prop_assert!((f64::from(found.sine) - angle.sin()).abs() <= 5e-7, "{:?} {}", found, angle);
            let half = (angle / 2.0).cos().powi(2);
            prop_assert!((f64::from(found.half_cosine_squared()) - half).abs() <= 5e-7 * half.sqrt() + 1e-12);
        }
    }
}
