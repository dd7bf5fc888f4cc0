//! The straight way of a move: a vector of integers, and its length.

use crate::single;
use crate::square_root::square_root_f32;

/// The way of X, Y and Z from one machine position to another, units of 10 nm.
#[derive(Clone, Copy, Debug)]
pub struct Path {
    /// The components, at most twice [`crate::kinematics::MAX_COORDINATE_10NM`] either way.
    pub vector_10nm: [i32; 3],
    /// Sum of the components' squares, exact: at most 3 * 10^18.
    squared: u64,
    /// Its root, to single precision.
    pub length: f32,
}

impl Path {
    /// The way between two positions within [`crate::kinematics::MAX_COORDINATE_10NM`].
    #[inline(always)]
    pub fn between(from_10nm: [i32; 3], to_10nm: [i32; 3]) -> Self {
        let ([from_x, from_y, from_z], [to_x, to_y, to_z]) = (from_10nm, to_10nm);
        // Differences of 31 bits, squares of 60.
        let vector_10nm = [to_x.wrapping_sub(from_x), to_y.wrapping_sub(from_y), to_z.wrapping_sub(from_z)];
        let [x, y, z] = vector_10nm.map(|component| (i64::from(component) * i64::from(component)).cast_unsigned());
        let squared = x.wrapping_add(y).wrapping_add(z);
        Self { vector_10nm, squared, length: square_root_f32(single::of_u64(squared)) }
    }

    /// The length to the nearest unit.
    #[inline(always)]
    pub fn length_10nm(&self) -> u32 {
        // The single-precision root is within 2 up to 168 mm, within 128 for the longest way there is.
        // The longest way has 31 bits.
        let mut root = self.length as u32;
        let product = |a: u32, b: u32| u64::from(a) * u64::from(b);
        while product(root, root.wrapping_add(1)) < self.squared {
            root = root.wrapping_add(1);
        }
        while root > 0 && product(root, root.wrapping_sub(1)) >= self.squared {
            root = root.wrapping_sub(1);
        }
        root
    }
}

/// The scalar product of two vectors of at most 10^9 a component, exact.
#[inline(always)]
fn dot(a: [i32; 3], b: [i32; 3]) -> i64 {
    let ([ax, ay, az], [bx, by, bz]) = (a, b);
    let product = |a: i32, b: i32| i64::from(a) * i64::from(b);
    product(ax, bx).wrapping_add(product(ay, by)).wrapping_add(product(az, bz))
}

/// Squared sine and cosine of half the angle by which a way turns from one to the next, to single precision also
/// where they are small; `None` where one of the two has no length.
///
/// sin = |a x b| / |a||b| and cos = a b / |a||b| come from exact integers, so nothing cancels; of the two halves,
/// sin^2(theta/2) = (1 - cos)/2 and cos^2(theta/2) = (1 + cos)/2, the larger is taken from the cosine and the other
/// from the sine, by sin = 2 sin(theta/2) cos(theta/2).
pub fn half_turn(before: &Path, after: &Path) -> Option<(f32, f32)> {
    let product = before.length * after.length;
    if product <= 0.0 {
        return None;
    }
    let ([ax, ay, az], [bx, by, bz]) = (before.vector_10nm, after.vector_10nm);
    let minor = |a: i32, b: i32, c: i32, d: i32| {
        single::of_i64((i64::from(a) * i64::from(b)).wrapping_sub(i64::from(c) * i64::from(d)))
    };
    let inverse = 1.0 / product;
    let cosine = single::of_i64(dot(before.vector_10nm, after.vector_10nm)) * inverse;
    let mut cross = [0.0, 0.0, minor(ax, by, ay, bx) * inverse];
    if az != 0 || bz != 0 {
        cross[0] = minor(ay, bz, az, by) * inverse;
        cross[1] = minor(az, bx, ax, bz) * inverse;
    }
    let sine_squared = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2];
    let larger = 0.5 * (1.0 + if cosine < 0.0 { -cosine } else { cosine });
    let smaller = 0.25 * sine_squared / larger;
    Some(if cosine < 0.0 { (larger, smaller) } else { (smaller, larger) })
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
        fn lengths_are_rounded_to_the_nearest_unit(
            from in proptest::array::uniform3(coordinate()), to in proptest::array::uniform3(coordinate()),
        ) {
            let path = Path::between(from, to);
            let squared: u128 = from.iter().zip(to).map(|(from, to)| u128::from((to - from).unsigned_abs()).pow(2)).sum();
            let root = u128::from(path.length_10nm());
            // (root - 1/2)^2 < squared < (root + 1/2)^2; there are no ties.
            prop_assert!(4 * squared < (2 * root + 1).pow(2));
            prop_assert!(root == 0 || 4 * squared > (2 * root - 1).pow(2));
            let exact = (squared as f64).sqrt();
            prop_assert!((f64::from(path.length) - exact).abs() <= 1.2e-7 * exact);
        }

        #[test]
        fn half_angles_have_single_precision(
            a in proptest::array::uniform3(coordinate()), b in proptest::array::uniform3(coordinate()),
            turn in prop_oneof![Just(None), (-1_000i32..1_000).prop_map(Some)],
        ) {
            // Nearly in line, too.
            let b = match turn {
                Some(turn) => [a[0] + turn, a[1] - turn, a[2] + turn / 3],
                None => b,
            };
            let (one, other) = (Path::between([0; 3], a), Path::between([0; 3], b));
            let Some((sine, cosine)) = half_turn(&one, &other) else {
                prop_assert!(a == [0; 3] || b == [0; 3]);
                return Ok(());
            };
            let a = a.map(f64::from);
            let b = b.map(f64::from);
            let exact = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
            let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
            let full = exact(cross).atan2(a.iter().zip(b).map(|(a, b)| a * b).sum());
            let (s, c) = ((full / 2.0).sin().powi(2), (full / 2.0).cos().powi(2));
            prop_assert!((f64::from(sine) - s).abs() <= 1e-6 * s + 1e-30, "{} {}", sine, s);
            prop_assert!((f64::from(cosine) - c).abs() <= 1e-6 * c + 1e-15, "{} {}", cosine, c);
        }
    }
}
