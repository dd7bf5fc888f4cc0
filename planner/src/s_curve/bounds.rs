//! Speeds, lengths and times that a jerk and an acceleration allow.
//!
//! A ramp changes the speed by dv: the acceleration rises at the jerk j, is held at the machine's
//! limit a where it gets there, and falls at the same jerk. Without the part in the middle that is
//! the ramp of Li 2017, eqs. 1 to 4, which takes 2 sqrt(dv/j). It reaches a where dv = a^2/j;
//! beyond, it takes dv/a + a/j. Either way it is point-symmetric, so that its mean speed is the
//! mean of both ends': its length is (v0 + v1)/2 of its duration.

use crate::real::Real;

/// Largest jerk and acceleration along the path. Any unit of length; seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds<F> {
    /// The jerk.
    pub jerk: F,
    /// The acceleration.
    pub acceleration: F,
}

/// Bisections of an interval of speeds: it is then 2^-24 of its former length, the resolution of
/// f32.
const BISECTIONS: usize = 24;

/// Newton's steps to a reach: they start less than a third too high, and each squares
/// the relative error.
const REACH_STEPS: usize = 6;

/// Part of a length that is not counted on, so that rounding in f32 never asks for
/// more than is there.
const KEPT_BACK: f64 = 1.0 / 65_536.0;

fn larger<F: Real>(one: F, other: F) -> F {
    if other > one { other } else { one }
}

fn smaller<F: Real>(one: F, other: F) -> F {
    if other < one { other } else { one }
}

impl<F: Real> Bounds<F> {
    /// Half the duration of a ramp between two speeds.
    pub fn half_time(&self, one: F, other: F) -> F {
        self.half_time_of(if one > other { one - other } else { other - one })
    }

    /// Half the duration of a ramp that changes the speed by `change`.
    pub fn half_time_of(&self, change: F) -> F {
        if change > self.change_by_jerk() {
            F::constant(0.5) * (change / self.acceleration + self.acceleration / self.jerk)
        } else {
            (change / self.jerk).square_root()
        }
    }

    /// The greatest change of speed that a ramp makes without holding its acceleration.
    fn change_by_jerk(&self) -> F {
        self.acceleration * self.acceleration / self.jerk
    }

    /// Duration of the first and of the last part of a ramp, in which the jerk acts, and the change
    /// of speed in each.
    pub(crate) fn jerk_part(&self, change: F) -> (F, F) {
        let by_jerk = self.change_by_jerk();
        if change > by_jerk {
            (self.acceleration / self.jerk, F::constant(0.5) * by_jerk)
        } else {
            ((change / self.jerk).square_root(), F::constant(0.5) * change)
        }
    }

    /// Length of a ramp between two speeds.
    pub fn length(&self, one: F, other: F) -> F {
        (one + other) * self.half_time(one, other)
    }

    /// The fastest speed that can be reached from `speed` over a length, or from which that
    /// speed can be reached.
    pub fn reach(&self, speed: F, length: F) -> F {
        if length <= F::ZERO {
            return speed;
        }
        let length = length * F::constant(1.0 - KEPT_BACK);
        let by_jerk = self.change_by_jerk();
        let gain = if (speed + speed + by_jerk) * self.acceleration < length * self.jerk {
            self.gain_at_acceleration(speed, length)
        } else {
            self.gain_at_jerk(speed, length)
        };
        if gain > F::ZERO { speed + gain } else { speed }
    }

    /// Speed gained over a length by jerk alone. With y the gain, (2v + y) sqrt(y/j) = L; with z =
    /// sqrt(y), z^3 + 2vz - L sqrt(j) = 0, convex for z > 0 and with one root there. Newton's
    /// steps, a fixed number, descend to it from above.
    fn gain_at_jerk(&self, speed: F, length: F) -> F {
        let whole = length * self.jerk.square_root();
        let twice = speed + speed;
        let curve = crate::cubic::Cubic { linear: twice, cubic: F::constant(1.0) };
        let mut z = F::from_f32(curve_guess(twice.to_f32(), whole.to_f32()));
        for _ in 0..REACH_STEPS {
            z = z - (curve.at(z) - whole) / curve.slope(z);
        }
        z * z
    }

    /// (2v + y) (y/a + a/j) = 2L is y^2 + 2by = c with b = v + a^2/2j and c = 2 (La - v a^2/j): y =
    /// c/(b + sqrt(b^2 + c)).
    fn gain_at_acceleration(&self, speed: F, length: F) -> F {
        let by_jerk = self.change_by_jerk();
        let b = speed + F::constant(0.5) * by_jerk;
        let half = length * self.acceleration - speed * by_jerk;
        let c = half + half;
        c / (b + (b * b + c).square_root())
    }

    /// The largest speed at most `wanted` to which one can go from `entry` over a length; `entry`
    /// itself where no slower one is near enough.
    ///
    /// Not every slower speed is nearer than a still slower one: the way down to x grows with x up
    /// to a crest, because the acceleration has to be gone at both ends of a ramp. Beyond the
    /// crest it falls again.
    pub fn exit_within(&self, entry: F, wanted: F, length: F) -> F {
        if wanted >= entry {
            return smaller(wanted, self.reach(entry, length));
        }
        let fits = |exit: F| self.length(entry, exit) <= length;
        if fits(wanted) {
            return wanted;
        }
        let crest = self.crest(entry);
        if fits(F::ZERO) {
            return self.last_that(F::ZERO, smaller(wanted, crest), fits);
        }
        // No speed below fits: the slowest of those that are only a little slower, from the
        // fast end downwards.
        let low = larger(wanted, crest);
        if fits(low) {
            return low;
        }
        entry - self.last_that(F::ZERO, entry - low, |drop| fits(entry - drop))
    }

    /// The speed that is farthest from `entry` of those below it: with y = `entry` - x, the
    /// length (2x + y) sqrt(y/j) has its greatest value at x = y/2, a third of `entry`, where
    /// it is 9 % more than to a stop; where the acceleration is held, (2x + y) (y/a + a/j)/2
    /// has it at x = a^2/2j.
    fn crest(&self, entry: F) -> F {
        smaller(entry * F::constant(1.0 / 3.0), F::constant(0.5) * self.change_by_jerk())
    }

    /// The greatest speed at most `most`, and not below the ends', to which one can go and come
    /// back over a length.
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

    /// Duration of a length at these speeds; `peak` must fit.
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

/// First guess for the root of z^3 + bz = c: not below it and less than a third above it. It is the
/// smaller of the roots of both parts alone.
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
            // Rounding loses so small a gain.
            let is_lost = reached - speed <= 1e-9 * speed;
            prop_assert!(needed <= length * (1.0 + 1e-9) || is_lost, "{} > {}", needed, length);
            prop_assert!(needed >= length * (1.0 - 1e-4) || is_lost, "{} < {}", needed, length);
            // The f32 result asks for no more length than there is, as f64 sees it, but for the
            // rounding of the speed itself.
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
