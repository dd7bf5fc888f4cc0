//! The cubic by which path depends on time under constant jerk.

use crate::real::Real;

/// Path over time beside a place where the acceleration is zero: `linear x + cubic x^3` at share x
/// of half a ramp.
///
/// With V the speed there and t1 the half's duration, linear = V t1 and cubic = +-j t1^3 / 6: plus
/// at a ramp's slow end, whichever direction time runs, and minus at its fast end. There j t1^2 is
/// at most V, so the path grows with x everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cubic<F> {
    /// Path due to the speed at the place, in one half.
    pub linear: F,
    /// Path due to the jerk.
    pub cubic: F,
}

/// Newton steps in f32. Starting from the guess, which is less than a third too large, each squares
/// the relative error.
const STEPS: usize = 5;

/// Cube root of a positive number, at most 7 % too large: the bits of a float approximate its
/// logarithm.
pub(crate) fn cube_root_above(x: f32) -> f32 {
    f32::from_bits(x.to_bits() / 3 + 0x2a51_0000) * 1.035
}

impl<F: Real> Cubic<F> {
    /// The same curve in another unit of path; `factor` of the new units make one of the old.
    pub(crate) fn scaled(&self, factor: F) -> Self {
        Self { linear: self.linear * factor, cubic: self.cubic * factor }
    }

    /// Distance at share `x` of the half.
    pub(crate) fn at(&self, x: F) -> F {
        x * (self.linear + self.cubic * x * x)
    }

    /// Slope of the distance at share `x`.
    pub(crate) fn slope(&self, x: F) -> F {
        self.linear + F::constant(3.0) * self.cubic * x * x
    }

    /// Share at which a distance is reached, by a fixed number of Newton steps; zero for distances
    /// that are not positive.
    ///
    /// At a slow end the path is convex and the guess not below the root, at a fast one it is
    /// concave and the guess not above it: either way the steps approach the root and never pass
    /// it.
    pub(crate) fn solve(&self, distance: F) -> F {
        let short = Cubic { linear: self.linear.to_f32(), cubic: self.cubic.to_f32() };
        let guess = short.solve_f32(distance.to_f32());
        // One step doubles the digits, which f64 needs and f32 tolerates.
        let x = F::from_f32(guess);
        let slope = self.slope(x);
        if guess > 0.0 && slope > F::ZERO {
            let better = x - (self.at(x) - distance) / slope;
            if better > F::ZERO { better } else { F::ZERO }
        } else {
            F::ZERO
        }
    }
}

impl Cubic<f32> {
    /// Single-precision version of [`Cubic::solve`].
    pub(crate) fn solve_f32(&self, distance: f32) -> f32 {
        if distance <= 0.0 || self.linear <= 0.0 && self.cubic <= 0.0 {
            return 0.0;
        }
        let mut x = distance / self.linear;
        if self.cubic > 0.0 {
            let root = cube_root_above(distance / self.cubic);
            // The quotient is infinite if the linear term is 0.
            if x > root {
                x = root;
            }
        }
        for _ in 0..STEPS {
            let rise = self.cubic * x * x;
            x = x - (x * (self.linear + rise) - distance) / (self.linear + 3.0 * rise);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn guesses_are_just_above_the_cube_root(exponent in -30.0f32..30.0) {
            let x = 10f32.powf(exponent);
            let guess = cube_root_above(x);
            let root = x.cbrt();
            prop_assert!(guess >= root * 0.999 && guess <= root * 1.09, "{} {}", guess, root);
        }

        #[test]
        fn roots_are_found(
            linear in prop_oneof![Just(0.0f64), 1e-6f64..1e7], ratio in 1e-9f64..1e6, x in 1e-4f64..=1.0, slow in any::<bool>(),
        ) {
            // At a fast end the cubic part is at most a sixth of the linear part.
            let cubic = match (slow, linear > 0.0) {
                (true, true) => linear * ratio,
                (true, false) => ratio,
                (false, _) => -linear * (ratio / 1e6) / 6.0,
            };
            prop_assume!(linear > 0.0 || slow);
            let curve = Cubic { linear, cubic };
            let found = curve.solve(curve.at(x));
            prop_assert!((found - x).abs() <= 1e-11 * x, "{} {}", found, x);
            let short = Cubic { linear: linear as f32, cubic: cubic as f32 };
            let found = short.solve(curve.at(x) as f32);
            prop_assert!((f64::from(found) - x).abs() <= 1e-6 * x, "{} {}", found, x);
        }
    }

    #[test]
    fn no_distance_takes_no_time() {
        for cubic in [0.0, 1.0, -1.0 / 6.0] {
            assert_eq!(Cubic { linear: 1.0f64, cubic }.solve(0.0), 0.0);
            assert_eq!(Cubic { linear: 1.0f64, cubic }.solve(-1.0), 0.0);
        }
        assert_eq!(Cubic { linear: 0.0f64, cubic: 8.0 }.solve(0.0), 0.0);
        assert!((Cubic { linear: 0.0f64, cubic: 8.0 }.solve(1.0) - 0.5).abs() < 1e-12);
    }
}
