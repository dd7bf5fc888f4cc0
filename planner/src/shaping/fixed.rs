//! Positions in whole numbers: what is worked out at every breakpoint, on a processor without
//! double precision.
//!
//! A position is in units of 2^-32 step. Products are of 32 by 32 bits, which the processor has an
//! instruction for.

use super::path_pieces::Polynomial;

/// Positions' units in a step, as a shift.
pub(super) const STEP_BITS: u32 = 32;

/// Half a step.
pub(super) const HALF_STEP: i64 = 1 << (STEP_BITS - 1);

/// Scale of parts of a line, as a shift.
const PART_BITS: i32 = 56;

/// Weights' units in a whole, as a shift: the weights of an axis sum to exactly this whole.
pub(super) const WEIGHT_BITS: u32 = 30;

/// Bits of the largest coefficient, without its sign: the sum of three fits in 64.
const COEFFICIENT_BITS: i32 = 61;

/// The most by which coefficients are enlarged, a shift.
const MOST_ENLARGED: i32 = 63;

/// A number of steps as a position.
#[inline]
pub(super) const fn of_steps(steps: i64) -> i64 {
    steps.wrapping_shl(STEP_BITS)
}

/// A number of 1/256 steps as a position.
#[inline]
pub(super) const fn of_256ths(steps_256ths: i32) -> i64 {
    (steps_256ths as i64) << (STEP_BITS - 8)
}

/// The part of its line that is done over a piece of the plan: a polynomial of third degree in the
/// share of a span of time, a power of two of ticks that is longer than the piece.
#[derive(Clone, Copy, Debug)]
pub(super) struct PartLaw {
    /// The part at the piece's start, 2^-56.
    start: i64,
    /// Coefficient of the speed at the start: its part of the line in the span, 2^-56 over
    /// 2^[`PartScale::enlarged`].
    speed: i64,
    /// Coefficients of half the acceleration, and of a sixth of the jerk, without
    /// the lower 32 bits.
    acceleration: i32,
    jerk: i32,
}

/// The units of a [`PartLaw`]; apart from it, so that a piece of the plan has no gaps in memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct PartScale {
    /// Shift by which the coefficients are enlarged.
    enlarged: u8,
    /// Ticks of the span: 2 to the power of this.
    span_bits: u8,
}

/// Speed, acceleration and jerk at a moment: in parts of a line, or steps, and ticks.
#[derive(Clone, Copy, Debug)]
pub(super) struct PartRates {
    pub speed: f32,
    pub acceleration: f32,
    pub jerk: f32,
}

impl PartRates {
    /// Rest.
    pub const NONE: Self = Self { speed: 0.0, acceleration: 0.0, jerk: 0.0 };

    /// Adds those, times `factor`.
    #[inline]
    pub fn add(&mut self, rates: &Self, factor: f32) {
        self.speed += factor * rates.speed;
        self.acceleration += factor * rates.acceleration;
        self.jerk += factor * rates.jerk;
    }
}

impl PartScale {
    /// Scale of a resting piece, which may be any. All zeros, so that images hold no copy
    /// of an empty ring.
    pub const NONE: Self = Self { enlarged: 0, span_bits: 0 };

    /// Ticks as a share of the span, 2^-64.
    #[inline]
    fn share(&self, ticks: u64) -> u64 {
        ticks.wrapping_shl(64_u32.wrapping_sub(u32::from(self.span_bits)))
    }
}

impl PartLaw {
    /// Rest.
    pub const NONE: Self = Self { start: 0, speed: 0, acceleration: 0, jerk: 0 };

    /// Law of a piece that lasts `ticks`. Computed once a piece, in f64; at the piece's end it is
    /// exactly where the polynomial is, however the coefficients are rounded.
    #[inline(never)]
    pub fn new(part: &Polynomial, ticks: u64) -> (Self, PartScale) {
        let duration = ticks as f64;
        // A block under an S-curve may last a tick longer than its pieces.
        let span_bits = 64_u32.wrapping_sub(ticks.saturating_add(2).leading_zeros()).clamp(1, 63).cast_signed();
        let speed = scaled(part.speed, span_bits);
        let of_acceleration = scaled(part.acceleration, 2 * span_bits - 1);
        let of_jerk = if part.jerk == 0.0 { 0.0 } else { scaled(part.jerk * (1.0 / 6.0), 3 * span_bits) };
        let largest = magnitude(speed).max(magnitude(of_acceleration)).max(magnitude(of_jerk));
        let enlarged = (COEFFICIENT_BITS - PART_BITS - largest).clamp(0, MOST_ENLARGED);
        let bits = PART_BITS + enlarged;
        let (acceleration, jerk) = ((whole(of_acceleration, bits) >> 32) as i32, (whole(of_jerk, bits) >> 32) as i32);
        // The speed gets what rounding takes from these.
        let share = scaled(duration, -span_bits);
        let bent = if acceleration | jerk == 0 {
            0.0
        } else {
            share * scaled(f64::from(acceleration) + share * f64::from(jerk), 32)
        };
        let done = part.position_after(duration) - part.position;
        let start = whole(part.position, PART_BITS);
        let speed = whole(scaled(done, bits) / share - bent, 0);
        let scale = PartScale { enlarged: enlarged as u8, span_bits: span_bits as u8 };
        (Self { start, speed, acceleration, jerk }, scale)
    }

    /// The part after `ticks`, 2^-56.
    #[inline]
    pub fn at(&self, scale: PartScale, ticks: u64) -> i64 {
        let share = scale.share(ticks);
        let mut slope = self.speed;
        if self.is_bent() {
            let mut bend = i64::from(self.acceleration) << 32;
            if self.jerk != 0 {
                bend = bend.wrapping_add(times(i64::from(self.jerk) << 32, share));
            }
            slope = slope.wrapping_add(times(bend, share));
        }
        self.start.wrapping_add(times(slope, share) >> (scale.enlarged & 63))
    }

    /// The mean of the part over `ticks`, above zero, from `after` ticks on; of a law without jerk.
    pub fn mean(&self, scale: PartScale, after: u64, ticks: u32) -> i64 {
        /// A sixth, 2^-64.
        const SIXTH: u64 = u64::MAX / 6;
        let ticks = u64::from(ticks);
        let chord = self.at(scale, after).wrapping_add(self.at(scale, after.wrapping_add(ticks))) >> 1;
        if self.acceleration == 0 {
            return chord;
        }
        // A parabola with u^2 to its share u is by a sixth of the chord's squared length
        // below the chord.
        let share = scale.share(ticks);
        let bend = times(times(i64::from(self.acceleration) << 32, share), share);
        chord.wrapping_sub(times(bend, SIXTH) >> (scale.enlarged & 63))
    }

    /// Rates after `ticks`.
    #[inline]
    pub fn rates_at(&self, scale: PartScale, ticks: u64) -> PartRates {
        let unit = single_power_of_two(32 - PART_BITS - i32::from(scale.enlarged));
        let per_tick = single_power_of_two(-i32::from(scale.span_bits));
        let speed_unit = unit * per_tick;
        let speed = (self.speed >> 32) as i32 as f32;
        if !self.is_bent() {
            return PartRates { speed: speed * speed_unit, acceleration: 0.0, jerk: 0.0 };
        }
        let share = (scale.share(ticks) >> 32) as u32 as f32 * single_power_of_two(-32);
        let (half_acceleration, sixth_jerk) = (self.acceleration as f32, self.jerk as f32);
        let rise = 3.0 * share * sixth_jerk;
        let acceleration_unit = speed_unit * per_tick;
        PartRates {
            speed: (speed + share * (2.0 * half_acceleration + rise)) * speed_unit,
            acceleration: 2.0 * (half_acceleration + rise) * acceleration_unit,
            jerk: 6.0 * sixth_jerk * acceleration_unit * per_tick,
        }
    }

    /// True if it has no motion at all.
    #[inline]
    pub fn is_at_rest(&self) -> bool {
        self.speed == 0 && !self.is_bent()
    }

    /// True if the speed changes.
    #[inline]
    fn is_bent(&self) -> bool {
        self.acceleration | self.jerk != 0
    }
}

/// Part of a line (2^-56) times `steps`.
#[inline]
pub(super) fn along(steps: i32, part: i64) -> i64 {
    let steps = i64::from(steps);
    let upper = steps * i64::from((part >> 32) as i32);
    let lower = steps * i64::from(part as u32);
    (upper << (64 - PART_BITS)).wrapping_add(lower >> (PART_BITS - STEP_BITS.cast_signed()))
}

/// Distance (2^-32 of 1/256 steps) summed over `ticks`: 2^-16 steps times ticks, modulo 2^64.
#[inline]
pub(super) fn summed_over_time(distance: i64, ticks: u32) -> i64 {
    let upper = i64::from((distance >> 32) as i32).wrapping_mul(i64::from(ticks));
    let lower = u64::from(distance as u32).wrapping_mul(u64::from(ticks));
    (upper << 8).wrapping_add((lower >> 24).cast_signed())
}

/// Position (2^-32 step) summed over `ticks`: 2^-16 steps times ticks, modulo 2^64.
#[inline]
pub(super) fn position_over_time(position: i64, ticks: u32) -> i64 {
    let upper = i64::from((position >> 32) as i32).wrapping_mul(i64::from(ticks));
    let lower = u64::from(position as u32).wrapping_mul(u64::from(ticks));
    (upper << 16).wrapping_add((lower >> 16).cast_signed())
}

/// Constant distance (2^-20 steps) summed over `ticks`: 2^-16 steps times ticks, modulo 2^64.
#[inline]
pub(super) fn constant_over_time(distance: i32, ticks: u64) -> i64 {
    let distance = i64::from(distance);
    let (upper, lower) = (i64::from((ticks >> 32) as i32), i64::from(ticks as u32));
    (distance.wrapping_mul(upper) << 28).wrapping_add(distance.wrapping_mul(lower) >> 4)
}

/// The mean over a number of ticks: a division by them as a product.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mean {
    /// 2^(32 + `bits`) over the ticks.
    reciprocal: u32,
    bits: u8,
}

impl Mean {
    /// Mean over no time.
    pub const NONE: Self = Self { reciprocal: 0, bits: 0 };

    /// Mean over `ticks`, at least 2 and at most 2^30.
    #[cold]
    pub fn over(ticks: u32) -> Self {
        let bits = (31_u32.wrapping_sub(ticks.leading_zeros())).min(30);
        let reciprocal = (1_u64 << (32 + bits)).wrapping_add(u64::from(ticks >> 1)).checked_div(u64::from(ticks));
        // A power of two itself is one too many.
        let reciprocal = reciprocal.unwrap_or(0).min(u64::from(u32::MAX));
        Self { reciprocal: reciprocal as u32, bits: bits as u8 }
    }

    /// The position (2^-32 step) of which this is the sum over time, 2^-16 steps times ticks.
    #[inline]
    pub fn of(self, sum: i64) -> i64 {
        let upper = i64::from((sum >> 32) as i32).wrapping_mul(i64::from(self.reciprocal));
        let lower = u64::from(sum as u32).wrapping_mul(u64::from(self.reciprocal)) >> 32;
        // 2^16 of the sum's units and 2^-bits of the reciprocal's.
        let (product, bits) = (upper.wrapping_add(lower.cast_signed()), u32::from(self.bits));
        if bits < 16 { product << (16_u32.wrapping_sub(bits)) } else { product >> (bits.wrapping_sub(16) & 31) }
    }
}

/// A sum of positions with weights.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WeightedSum {
    /// Whole steps, 2^-30.
    steps: i64,
    /// Fractions of a step, 2^-62. They cannot wrap, as the weights sum to one.
    fractions: u64,
}

impl WeightedSum {
    /// Adds a position with a weight, 2^-30.
    #[inline]
    pub fn add(&mut self, position: i64, weight: u32) {
        let steps = i64::from((position >> 32) as i32) * i64::from(weight.cast_signed());
        self.steps = self.steps.wrapping_add(steps);
        self.fractions = self.fractions.wrapping_add(u64::from(position as u32) * u64::from(weight));
    }

    /// The nearest position.
    #[inline]
    pub fn position(self) -> i64 {
        const HALF: u64 = 1 << (WEIGHT_BITS - 1);
        let fraction = self.fractions.wrapping_add(HALF) >> WEIGHT_BITS;
        (self.steps << (STEP_BITS - WEIGHT_BITS)).wrapping_add(fraction.cast_signed())
    }
}

/// A number times a share (2^-64), rounded down by less than three.
#[inline]
fn times(number: i64, share: u64) -> i64 {
    let (whole, part) = ((number >> 32) as i32, number as u32);
    let (upper, lower) = ((share >> 32) as u32, share as u32);
    let below = (u64::from(part) * u64::from(upper)) >> 32;
    // Needed only for a span longer than 2^32 ticks.
    let far_below = (i64::from(whole) * i64::from(lower)) >> 32;
    (i64::from(whole) * i64::from(upper)).wrapping_add(below.cast_signed()).wrapping_add(far_below)
}

/// The least power of two above a number's magnitude; of zero a very small one.
fn magnitude(x: f64) -> i32 {
    ((x.to_bits() >> 52) as i32 & 0x7ff) - 1022
}

/// A number times 2^bits, cut to a whole one. Once in the image: the processor has no
/// instruction for it.
#[inline(never)]
fn whole(x: f64, bits: i32) -> i64 {
    scaled(x, bits) as i64
}

/// Multiplies a number by a power of two, exactly; a result that is too small becomes zero. With
/// hardware it would be a product.
#[inline(never)]
fn scaled(x: f64, exponent: i32) -> f64 {
    let bits = x.to_bits();
    let now = (bits >> 52) as i32 & 0x7ff;
    let then = now.wrapping_add(exponent);
    if now == 0 || then <= 0 || then >= 0x7ff {
        return 0.0;
    }
    f64::from_bits(bits.wrapping_add_signed(i64::from(exponent) << 52))
}

/// 2^exponent, within what f32 has.
#[inline]
fn single_power_of_two(exponent: i32) -> f32 {
    f32::from_bits((exponent + 127).cast_unsigned() << 23)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A motion from 0 to the whole line, or a part of it, in a piece of `ticks`; `shape` are the
    /// shares that speed, acceleration and jerk have in it.
    fn part(ticks: f64, done: f64, start: f64, shape: [f64; 3]) -> Polynomial {
        let sum: f64 = shape.iter().sum();
        let [speed, acceleration, jerk] = shape.map(|share| share / sum * done);
        Polynomial {
            position: start,
            speed: speed / ticks,
            acceleration: 2.0 * acceleration / ticks / ticks,
            jerk: 6.0 * jerk / ticks / ticks / ticks,
        }
    }

    proptest! {
        #[test]
        fn a_part_is_where_the_polynomial_is(
            ticks in prop_oneof![1u64..1000, 1000u64..1 << 26, 1u64 << 30..1 << 38],
            at in 0.0f64..=1.0,
            exponent in -20.0f64..0.0,
            start in 0.0f64..0.5,
            shape in (0.0f64..1.0, -0.45f64..1.0, prop_oneof![Just(0.0), 0.0f64..1.0]),
        ) {
            let shape: [f64; 3] = shape.into();
            prop_assume!(shape.iter().sum::<f64>() > 0.3);
            let done = 0.5 * exponent.exp2();
            let path = part(ticks as f64, done, start, shape);
            let (law, scale) = PartLaw::new(&path, ticks);
            let near = |after: u64, most: f64| {
                let found = law.at(scale, after) as f64 / f64::from(PART_BITS).exp2();
                (found - path.position_after(after as f64)).abs() <= most
            };
            // Between the ends the error is within what 28 bits of acceleration and jerk leave; at
            // the ends within that of f64.
            prop_assert!(near((at * ticks as f64) as u64, done * 4e-9 + 1e-15));
            prop_assert!(near(0, 1e-15) && near(ticks, 1e-15));
            let rates = law.rates_at(scale, (at * ticks as f64) as u64);
            let expected = path.after(((at * ticks as f64) as u64) as f64);
            let largest = done / ticks as f64;
            prop_assert!((f64::from(rates.speed) - expected.speed).abs() <= 1e-5 * largest);
            prop_assert!((f64::from(rates.acceleration) - expected.acceleration).abs() <= 1e-4 * largest / ticks as f64);
        }

        #[test]
        fn a_weighted_sum_is_the_nearest_position(
            positions in proptest::collection::vec(-(1i64 << 58)..1 << 58, 5),
            cuts in proptest::collection::vec(0u32..1 << 28, 4),
        ) {
            let mut weights = cuts.clone();
            weights.push((1 << WEIGHT_BITS) - cuts.iter().sum::<u32>());
            let mut sum = WeightedSum::default();
            let mut exact = 0i128;
            for (position, weight) in positions.iter().zip(&weights) {
                sum.add(*position, *weight);
                exact += i128::from(*position) * i128::from(*weight);
            }
            prop_assert_eq!(i128::from(sum.position()), (exact + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS);
            // The sum is exact at rest.
            let mut sum = WeightedSum::default();
            weights.iter().for_each(|weight| sum.add(of_steps(-77_123), *weight));
            prop_assert_eq!(sum.position(), of_steps(-77_123));
        }

        #[test]
        fn steps_along_a_line_are_the_part_of_all(steps: i32, part in 0i64..=1 << PART_BITS) {
            let exact = (i128::from(steps) * i128::from(part)) >> (PART_BITS - 32);
            prop_assert!((i128::from(along(steps, part)) - exact).abs() <= 1);
        }

        #[test]
        fn what_is_summed_over_time_has_its_mean(
            distance in -(1i64 << 62)..1 << 62, constant: i32, ticks in 1u32..1 << 28, long in 0u64..1 << 40,
            sum in -(1i64 << 57)..1 << 57, over in 84_000u32..9_000_000,
        ) {
            let exact = (i128::from(distance) * i128::from(ticks)) >> 24;
            prop_assert!((exact as i64).wrapping_sub(summed_over_time(distance, ticks)).abs() <= 1);
            let exact = (i128::from(constant) * i128::from(long)) >> 4;
            prop_assert!((exact as i64).wrapping_sub(constant_over_time(constant, long)).abs() <= 1);
            let exact = (i128::from(sum) << 16) as f64 / f64::from(over);
            let mean = Mean::over(over).of(sum) as f64;
            prop_assert!((mean - exact).abs() <= 2.0 + exact.abs() * 2.4e-10, "{mean} {exact}");
            prop_assert_eq!(Mean::over(over).of(0), 0);
            let exact = (i128::from(distance) * i128::from(ticks)) >> 16;
            prop_assert!((exact as i64).wrapping_sub(position_over_time(distance, ticks)).abs() <= 1);
        }

        #[test]
        fn a_mean_part_is_the_integral_of_the_polynomial(
            ticks in prop_oneof![2u64..1000, 1000u64..1 << 22, 1u64 << 30..1 << 38],
            from in 0.0f64..1.0, to in 0.0f64..1.0, done in 1e-6f64..1.0, bend in -0.45f64..1.0,
        ) {
            let path = part(ticks as f64, done, 0.1, [1.0, bend, 0.0]);
            let (law, scale) = PartLaw::new(&path, ticks);
            let [from, to] = [from.min(to), from.max(to)].map(|share| (share * ticks as f64) as u64);
            prop_assume!(to > from && to - from < 1 << 23);
            let integral = |ticks: f64| {
                ticks * (path.position + ticks * (0.5 * path.speed + ticks * path.acceleration / 6.0))
            };
            let expected = if ticks < 1 << 22 {
                (integral(to as f64) - integral(from as f64)) / (to - from) as f64
            } else {
                // The integrals are too large to subtract: by Simpson's rule, exact for a parabola.
                let [first, middle, last] =
                    [from as f64, 0.5 * (from + to) as f64, to as f64].map(|at| path.position_after(at));
                (first + 4.0 * middle + last) / 6.0
            };
            let found = law.mean(scale, from, (to - from) as u32) as f64 / f64::from(PART_BITS).exp2();
            prop_assert!((found - expected).abs() <= done * 4e-9 + 1e-14, "{found} {expected}");
        }

        #[test]
        fn powers_of_two_scale_exactly(x in -1e12f64..1e12, exponent in -200i32..200) {
            prop_assert_eq!(scaled(x, exponent), x * f64::from(exponent).exp2());
        }
    }

    #[test]
    fn what_is_too_small_to_scale_is_zero() {
        assert_eq!(scaled(0.0, 60), 0.0);
        assert_eq!(scaled(1e-300, -100), 0.0);
    }
}
