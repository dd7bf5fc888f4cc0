//! Speeds and lengths that a jerk and an acceleration limit allow for a ramp of two halves.
//!
//! Li 2017, eqs. 1 to 4, changes the speed by dv in 2 t1, t1 = sqrt(dv/j), with a greatest
//! acceleration of j t1. The machine also limits the acceleration to a, which Li does not: if j t1
//! would exceed it, t1 = dv/a, and the jerk is the smaller dv/t1^2 = a^2/dv. In either case a ramp
//! is +j and then -j, and the speed at its middle is the mean of both speeds, so that its length is
//! (v0 + v1) t1, t1 = max(sqrt(dv/j), dv/a).

use ferrostep_planner::square_root::square_root;

/// Maximum jerk and acceleration along the path. Any unit of length; seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RampBounds {
    /// The jerk.
    pub(crate) jerk: f64,
    /// The acceleration.
    pub(crate) acceleration: f64,
}

/// Number of bisections of a speed interval, down to the rounding of f64.
const BISECTIONS: usize = 52;

impl RampBounds {
    /// Half the duration of a ramp between two speeds.
    pub(crate) fn half_time(&self, one: f64, other: f64) -> f64 {
        let change = (one - other).abs();
        square_root(change / self.jerk).max(change / self.acceleration)
    }

    /// Length of a ramp between two speeds.
    pub(crate) fn length(&self, one: f64, other: f64) -> f64 {
        (one + other) * self.half_time(one, other)
    }

    /// Fastest speed that can be reached from `speed` over a length, or from which `speed` can be
    /// reached.
    pub(crate) fn reach(&self, speed: f64, length: f64) -> f64 {
        if length <= 0.0 {
            return speed;
        }
        // The acceleration limit is not exceeded; without one, sqrt((v1 - v0)/j) (v1 - v0) < L.
        let by_acceleration = square_root(speed * speed + self.acceleration * length);
        let by_jerk = speed + cube_root(length * length * self.jerk);
        last_that(speed, by_acceleration.min(by_jerk), |fast| self.length(speed, fast) <= length)
    }

    /// Variant of [`Self::reach`] that, for slow speeds, returns the minimum of the speeds reached
    /// from a stop and from every speed below: a greater speed never reaches less.
    ///
    /// [`Self::reach`] alone does not guarantee that. The length (u + x) sqrt((u - x)/j) has its
    /// maximum at x = u/3, because the acceleration has to be gone at x: a start slightly faster
    /// than a stop reaches less than a stop. Look-ahead raises corner speeds, and the speeds it
    /// granted before must stay possible.
    pub(crate) fn reach_from_up_to(&self, speed: f64, length: f64) -> f64 {
        // Farthest reach, at x = u/3: L = 4/3 u sqrt(2u/3j).
        let root = cube_root(length * 0.75 * square_root(1.5 * self.jerk));
        let farthest = root * root;
        let reached = self.reach(speed, length);
        if speed < farthest / 3.0 { reached.min(farthest) } else { reached }
    }

    /// Slowest speed from `wanted` to `speed` such that it and all speeds in between can be reached
    /// over a length.
    pub(crate) fn slowest(&self, speed: f64, wanted: f64, length: f64) -> f64 {
        if wanted >= speed || self.length(speed, wanted) <= length {
            return wanted.min(speed);
        }
        // Above a third of the speed, the length grows as the speed falls.
        let low = wanted.max(speed / 3.0);
        if self.length(speed, low) <= length {
            return low;
        }
        speed - last_that(0.0, speed - low, |drop| self.length(speed, speed - drop) <= length)
    }

    /// Greatest speed, at most `most` and not below the speeds at the ends, that can be reached and
    /// left again over a length.
    pub(crate) fn peak(&self, entry: f64, exit: f64, most: f64, length: f64) -> f64 {
        let least = entry.max(exit);
        if most <= least {
            return least;
        }
        let most = most.min(self.reach(entry.min(exit), length)).max(least);
        last_that(least, most, |peak| self.length(entry, peak) + self.length(peak, exit) <= length)
    }
}

/// Largest number from `low` to `high` up to which `holds` is true.
fn last_that(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    if holds(high) {
        return high;
    }
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if holds(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// Cube root of a number that is not negative, by Newton's method from above: each step takes off a
/// third, until the error is squared each time.
fn cube_root(x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    // The bits of a float approximate its logarithm; a third of them is off by at most 7 %.
    let mut root = f64::from_bits(x.to_bits() / 3 + 0x2a9f_7893_0000_0000) * 1.1;
    for _ in 0..6 {
        root -= (root - x / (root * root)) / 3.0;
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ferrostep_random_cases::cases(2_000))]

        #[test]
        fn a_faster_start_reaches_as_much_and_its_ramp_fits(
            jerk in 0.0f64..7.0, acceleration in 0.5f64..4.5, length in -5.0f64..3.0, slow in 0.0f64..300.0, more in 0.0f64..300.0,
        ) {
            let bounds = RampBounds { jerk: 10f64.powf(jerk), acceleration: 10f64.powf(acceleration) };
            let length = 10f64.powf(length);
            let [one, other] = [slow, slow + more].map(|speed| bounds.reach_from_up_to(speed, length));
            prop_assert!(other >= one * (1.0 - 1e-9), "{} {}", one, other);
            prop_assert!(one >= slow && bounds.length(slow, one) <= length * (1.0 + 1e-9), "{}", one);
            // Little is given away: from a stop at most 9 % of the length.
            prop_assert!(bounds.length(slow, one) >= length * 0.9 || bounds.length(0.0, one) >= length * 0.9);
        }

        #[test]
        fn a_slower_end_fits(jerk in 0.0f64..7.0, acceleration in 0.5f64..4.5, speed in 0.0f64..300.0, share in 0.0f64..1.0, part in 0.0f64..2.0) {
            let bounds = RampBounds { jerk: 10f64.powf(jerk), acceleration: 10f64.powf(acceleration) };
            let wanted = speed * share;
            let length = bounds.length(speed, wanted) * part;
            let slowest = bounds.slowest(speed, wanted, length);
            prop_assert!((wanted..=speed).contains(&slowest));
            prop_assert!(bounds.length(speed, slowest) <= length * (1.0 + 1e-9) + 1e-12, "{} {}", slowest, length);
        }

        #[test]
        fn cube_roots_are_exact(exponent in -30.0f64..30.0) {
            let x = 10f64.powf(exponent);
            prop_assert!((cube_root(x) / x.cbrt() - 1.0).abs() < 1e-15 * 8.0, "{}", x);
        }
    }
}
