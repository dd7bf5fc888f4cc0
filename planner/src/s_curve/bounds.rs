//! What a jerk and an acceleration allow.
//!
//! Li 2017, eqs. 1 to 4, changes the speed by dv in 2 t1, t1 = sqrt(dv/j), with a greatest acceleration of j t1. The
//! machine has a limit a of that, too, which Li does not know: where j t1 would pass it, t1 = dv/a, and the jerk is the
//! smaller dv/t1^2 = a^2/dv. A ramp is +j and then -j in either case, and half of it the mean of both speeds, so that
//! its length is (v0 + v1) t1, t1 = max(sqrt(dv/j), dv/a).

use crate::real::Real;

/// Largest jerk and acceleration along the path. Any unit of length; seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds<F> {
    /// The jerk.
    pub jerk: F,
    /// The acceleration.
    pub acceleration: F,
}

/// Bisections of an interval of speeds: it is then 2^-24 of what it was, all that f32 tells.
const BISECTIONS: usize = 24;

/// Newton's steps to a reach: they start less than a third too high, and each squares the relative error.
const REACH_STEPS: usize = 6;

/// Part of a length that is not counted on, so that rounding in f32 never asks for more than is there.
const KEPT_BACK: f64 = 1.0 / 65_536.0;

fn larger<F: Real>(one: F, other: F) -> F {
    if other > one { other } else { one }
}

fn smaller<F: Real>(one: F, other: F) -> F {
    if other < one { other } else { one }
}

impl<F: Real> Bounds<F> {
    /// How long half of a ramp between two speeds takes.
    pub fn half_time(&self, one: F, other: F) -> F {
        self.half_time_of(if one > other { one - other } else { other - one })
    }

    /// How long half of a ramp that changes the speed by so much takes.
    pub fn half_time_of(&self, change: F) -> F {
        larger((change / self.jerk).square_root(), change / self.acceleration)
    }

    /// How long a ramp between two speeds is.
    pub fn length(&self, one: F, other: F) -> F {
        (one + other) * self.half_time(one, other)
    }

    /// The fastest speed that can be reached from `speed` over a length, or from which that speed can be reached.
    ///
    /// With y what is gained, (2v + y) sqrt(y/j) = L; with z = sqrt(y), z^3 + 2vz - L sqrt(j) = 0, convex where z > 0 and
    /// with one root there. Newton's steps from above it go down to it, a fixed number of them. Both sqrt and the limit of
    /// acceleration, v^2 + aL = v'^2, hold; the smaller is taken.
    pub fn reach(&self, speed: F, length: F) -> F {
        if length <= F::ZERO {
            return speed;
        }
        let length = length * F::constant(1.0 - KEPT_BACK);
        let whole = length * self.jerk.square_root();
        let twice = speed + speed;
        let curve = crate::cubic::Cubic { linear: twice, cubic: F::constant(1.0) };
        let mut z = F::from_f32(curve_guess(twice.to_f32(), whole.to_f32()));
        for _ in 0..REACH_STEPS {
            z = z - (curve.at(z) - whole) / curve.slope(z);
        }
        let by_jerk = speed + z * z;
        let by_acceleration = (speed * speed + self.acceleration * length).square_root();
        larger(smaller(by_jerk, by_acceleration), speed)
    }

    /// The largest speed at most `wanted` to which one can go from `entry` over a length; `entry` itself where none of
    /// what is slower is near enough.
    ///
    /// Not every slower speed is nearer than a still slower one: (u + x) sqrt((u - x)/j) grows with x up to u/3, where it
    /// is 9 % more than to a stop, because the acceleration has to be gone at both ends of a ramp.
    pub fn exit_within(&self, entry: F, wanted: F, length: F) -> F {
        if wanted >= entry {
            return smaller(wanted, self.reach(entry, length));
        }
        if self.length(entry, wanted) <= length {
            return wanted;
        }
        // What follows from v^2 = u^2 - aL; beside it, the jerk's part, which grows with the speed up to u/3.
        let squared = entry * entry - self.acceleration * length * F::constant(1.0 - KEPT_BACK);
        let slowest = if squared > F::ZERO { squared.square_root() } else { F::ZERO };
        let third = entry * F::constant(1.0 / 3.0);
        if slowest <= smaller(wanted, third) && self.length(entry, slowest) <= length {
            return self.last_that(slowest, smaller(wanted, third), |exit| self.length(entry, exit) <= length);
        }
        // Nothing below: the slowest of those that are only a little slower.
        self.slowest_near(entry, wanted, length)
    }

    /// The smallest speed at least `wanted`, which is below `entry`, such that it and all between can be reached over a
    /// length.
    pub fn slowest_near(&self, entry: F, wanted: F, length: F) -> F {
        let third = entry * F::constant(1.0 / 3.0);
        let low = larger(wanted, third);
        if self.length(entry, low) <= length {
            return low;
        }
        // From the fast end downwards: the lengths grow.
        let gap = self.last_that(F::ZERO, entry - low, |drop| self.length(entry, entry - drop) <= length);
        entry - gap
    }

    /// The greatest speed at most `most`, and not below the ends', to which one can go and come back over a length.
    pub fn peak(&self, entry: F, exit: F, most: F, length: F) -> F {
        let fits = |peak: F| self.length(entry, peak) + self.length(peak, exit) <= length;
        let least = larger(entry, exit);
        if most <= least {
            return least;
        }
        if fits(most) {
            return most;
        }
        let most = smaller(most, self.reach(smaller(entry, exit), length));
        self.last_that(least, larger(most, least), fits)
    }

    /// How long a length takes at these speeds; `peak` must fit.
    pub fn duration(&self, entry: F, peak: F, exit: F, length: F) -> F {
        let (up, down) = (self.half_time(entry, peak), self.half_time(peak, exit));
        let cruise = length - (entry + peak) * up - (peak + exit) * down;
        let ramps = up + up + down + down;
        if cruise > F::ZERO { ramps + cruise / peak } else { ramps }
    }

    /// The last speed from `low` on, for which it holds, to `high` for which something holds.
    fn last_that(&self, low: F, high: F, holds: impl Fn(F) -> bool) -> F {
        let (mut low, mut high) = (low, high);
        if holds(high) {
            return high;
        }
        for _ in 0..BISECTIONS {
            let middle = (low + high) * F::constant(0.5);
            if holds(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
}

/// Not below the root of z^3 + bz = c, and less than a third above it: the smaller of the roots of both parts alone.
fn curve_guess(b: f32, c: f32) -> f32 {
    let by_cube = crate::cubic::cube_root_above(c);
    let by_line = c / b;
    if by_line < by_cube { by_line } else { by_cube }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn speed() -> impl Strategy<Value = f64> {
        prop_oneof![Just(0.0), (-3.0f64..2.7).prop_map(|exponent| 10f64.powf(exponent))]
    }

    fn bounds() -> impl Strategy<Value = Bounds<f64>> {
        (0.0f64..7.0, 0.5f64..4.5)
            .prop_map(|(jerk, acceleration)| Bounds { jerk: 10f64.powf(jerk), acceleration: 10f64.powf(acceleration) })
    }

    fn length() -> impl Strategy<Value = f64> {
        (-5.0f64..3.0).prop_map(|exponent| 10f64.powf(exponent))
    }

    fn short(bounds: &Bounds<f64>) -> Bounds<f32> {
        Bounds { jerk: bounds.jerk as f32, acceleration: bounds.acceleration as f32 }
    }

    proptest! {
        #![proptest_config(ferrostep_random_cases::cases(2_000))]

        #[test]
        fn a_reach_takes_the_length(bounds in bounds(), speed in speed(), length in length()) {
            let reached = bounds.reach(speed, length);
            let needed = bounds.length(speed, reached);
            // So small a gain is lost in rounding.
            let is_lost = reached - speed <= 1e-9 * speed;
            prop_assert!(needed <= length * (1.0 + 1e-9) || is_lost, "{} > {}", needed, length);
            prop_assert!(needed >= length * (1.0 - 1e-4) || is_lost, "{} < {}", needed, length);
            // In f32 it asks for no more than there is, as f64 sees it, but for the rounding of the speed itself.
            let found = f64::from(short(&bounds).reach(speed as f32, length as f32));
            let from = f64::from(speed as f32);
            let slower = found * (1.0 - 1.2e-7);
            prop_assert!(slower <= from || bounds.length(from, slower) <= length, "{} {}", found, reached);
            prop_assert!(found >= reached * (1.0 - 2e-6), "{} {}", found, reached);
        }

        #[test]
        fn exits_are_feasible_where_a_slower_one_is(
            bounds in bounds(), entry in 0.01f64..500.0, old in 0.0f64..1.0, wanted in 0.0f64..2.0, more in 1.0f64..1.2,
        ) {
            let old = entry * old;
            let length = bounds.length(entry, old) * more;
            let wanted = larger(entry * wanted, old);
            let exit = bounds.exit_within(entry, wanted, length);
            prop_assert!(exit <= wanted && bounds.length(entry, exit) <= length * (1.0 + 1e-12), "{} {}", exit, length);
            prop_assert!(exit >= old * (1.0 - 1e-6));
        }

        #[test]
        fn peaks_fill_the_length(
            bounds in bounds(), entry in speed(), exit in speed(), most in speed(), extra in length(),
        ) {
            let least = entry.max(exit);
            let length = bounds.length(entry, exit) + extra;
            let peak = bounds.peak(entry, exit, most, length);
            let needed = bounds.length(entry, peak) + bounds.length(peak, exit);
            prop_assert!(peak >= least && (peak <= most || peak == least));
            prop_assert!(needed <= length * (1.0 + 1e-12));
            prop_assert!(peak >= most || needed >= length * (1.0 - 1e-4) || peak - least <= 1e-5 * (1.0 + least), "{} {}", needed, length);
        }
    }
}
