//! The extruder's position: an exact sum, delivered in 1/256 steps.

use crate::division::Divisor;
use crate::kinematics::{Fraction, StepsPerMm};
use crate::units::UNITS_PER_256TH;

pub use crate::units::FILAMENT_UNITS_PER_MM;

/// Longest delta, 1 m.
const MAX_MOVE_100PM: i64 = 1_000 * FILAMENT_UNITS_PER_MM;

/// Largest product of a delta and the steps/mm that fits in an i64 together with a remainder.
const LARGEST_PRODUCT: u64 = 4_000_000_000_000_000_000;

/// The extruder's exact position, the sum of all its deltas, in whole 1/256 steps and a remainder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extruder {
    steps_per_mm: StepsPerMm,
    at: ExtruderPosition,
}

/// Position of the extruder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ExtruderPosition {
    whole_256ths: i64,
    /// Remainder in fractions of 1/256 step, of which [`StepsPerMm::of_filament`]'s denominator
    /// makes one. It is less than one, also at negative positions.
    remainder: u32,
}

impl ExtruderPosition {
    /// Position in 1/256 steps, truncated towards zero.
    #[inline(always)]
    pub fn position_256ths(self) -> i64 {
        if self.whole_256ths >= 0 {
            return self.whole_256ths;
        }
        self.whole_256ths.wrapping_add(i64::from(self.remainder != 0))
    }
}

impl Extruder {
    /// New extruder at zero.
    pub const fn new(steps_per_mm: StepsPerMm) -> Self {
        Self { steps_per_mm, at: ExtruderPosition { whole_256ths: 0, remainder: 0 } }
    }

    /// Sets the steps per mm of filament from here on. A remainder of less than 1/256 step is
    /// discarded.
    pub(crate) fn set_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) {
        let at = ExtruderPosition { whole_256ths: self.position_256ths(), remainder: 0 };
        *self = Self { steps_per_mm, at };
    }

    /// True if the extruder can move by a delta, in units of 0.1 nm, in one go: at most 1 m either
    /// way, and less above 4,000 steps/mm, where the product with the steps would exceed 64 bits.
    #[inline(always)]
    pub const fn can_push(steps_per_mm: StepsPerMm, delta_100pm: i64) -> bool {
        // 1 m times the maximum steps/mm is 10^19, which fits a u64 and saves a division per line.
        let magnitude = delta_100pm.unsigned_abs();
        // Every machine can push 21 cm: 2^31 * 10^9.
        magnitude >> 31 == 0
            || magnitude <= MAX_MOVE_100PM as u64
                && magnitude * steps_per_mm.hundred_thousandths().unsigned_abs() <= LARGEST_PRODUCT
    }

    /// Adds a delta in units of 0.1 nm for which [`Self::can_push`] holds (a longer one is
    /// ignored).
    pub fn advance(&mut self, delta_100pm: i64) {
        self.set(self.advanced(delta_100pm));
    }

    /// Position after a delta in units of 0.1 nm for which [`Self::can_push`] holds (a longer one
    /// is ignored).
    #[inline(always)]
    pub(crate) fn advanced(&self, delta_100pm: i64) -> ExtruderPosition {
        // Usual case of a printing move: up to some millimetres of filament, for which the hardware
        // division suffices.
        if let Ok(delta) = u32::try_from(delta_100pm)
            && self.steps_per_mm.of_filament().is_some()
            && let Some(place) = self.divided(delta)
        {
            return place;
        }
        self.far_advanced(delta_100pm)
    }

    /// Position after a delta, by hardware division; `None` if the product exceeds 32 bits.
    #[inline(always)]
    fn divided(&self, delta_100pm: u32) -> Option<ExtruderPosition> {
        let ExtruderPosition { whole_256ths, remainder } = self.at;
        let Fraction { numerator, denominator } = self.steps_per_mm.of_filament();
        let parts = u64::from(delta_100pm) * u64::from(numerator) + u64::from(remainder);
        let parts = u32::try_from(parts).ok()?;
        let whole = parts / denominator;
        let remainder = parts.wrapping_sub(whole.wrapping_mul(denominator.get()));
        Some(ExtruderPosition { whole_256ths: whole_256ths.wrapping_add(whole.into()), remainder })
    }

    #[inline(never)]
    fn far_advanced(&self, delta_100pm: i64) -> ExtruderPosition {
        const BY_UNITS: Divisor = Divisor::new(UNITS_PER_256TH);
        let ExtruderPosition { whole_256ths, remainder } = self.at;
        if !Self::can_push(self.steps_per_mm, delta_100pm) {
            return self.at;
        }
        let unit = self.remainder_unit();
        let product = delta_100pm * self.steps_per_mm.hundred_thousandths();
        let (whole, rest) = BY_UNITS.divide_floor(i64::from(remainder * unit) + product);
        ExtruderPosition { whole_256ths: whole_256ths + whole, remainder: rest as u32 / unit }
    }

    /// Units of filament times units of steps/mm in a unit of the remainder. Both are multiples
    /// of it.
    fn remainder_unit(&self) -> u32 {
        UNITS_PER_256TH as u32 / self.steps_per_mm.of_filament().denominator
    }

    /// Sets the position.
    #[inline(always)]
    pub(crate) fn set(&mut self, at: ExtruderPosition) {
        self.at = at;
    }

    /// Adds a whole number of 1/256 steps to the position.
    pub fn advance_256ths(&mut self, delta_256ths: i32) {
        self.at = ExtruderPosition { whole_256ths: self.position_256ths() + i64::from(delta_256ths), remainder: 0 };
    }

    /// Position in 1/256 steps, truncated towards zero.
    ///
    /// Truncated, not rounded: [`rounded_steps`] of the truncated value is then always the rounding
    /// of the exact one (nested floors), which rounding twice would miss.
    pub fn position_256ths(&self) -> i64 {
        self.at.position_256ths()
    }

    /// Sets the motor to this step after an abandoned move. Returns the filament between there and
    /// the move's target, units of 0.1 nm; 0 if both are the same step, fractions included.
    pub fn reset_to(&mut self, steps: i64) -> i64 {
        if rounded_steps(self.position_256ths()) == steps {
            return 0;
        }
        let whole = i128::from(self.at.whole_256ths) - 256 * i128::from(steps);
        let missing =
            whole * i128::from(UNITS_PER_256TH) + i128::from(self.at.remainder) * i128::from(self.remainder_unit());
        self.at = ExtruderPosition { whole_256ths: 256 * steps, remainder: 0 };
        (missing / i128::from(self.steps_per_mm.hundred_thousandths())) as i64
    }
}

/// Motor step of a position in 1/256 steps: nearest, halves away from zero.
#[inline(always)]
pub const fn rounded_steps(position_256ths: i64) -> i64 {
    // A position has at most 55 bits: nothing wraps.
    if position_256ths < 0 {
        (128_i64.wrapping_sub(position_256ths) >> 8).wrapping_neg()
    } else {
        position_256ths.wrapping_add(128) >> 8
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_motor_stands_at_the_rounded_exact_sum(
            steps_per_mm in 0.5f64..2000.0,
            deltas in proptest::collection::vec(-2_000_000_000i64..2_000_000_000, 1..50),
        ) {
            let steps_per_mm = StepsPerMm::from_f64(steps_per_mm).unwrap();
            let mut extruder = Extruder::new(steps_per_mm);
            let mut sum = 0i128;
            for delta in deltas {
                extruder.advance(delta);
                sum += i128::from(delta) * i128::from(steps_per_mm.hundred_thousandths());
                let unit = 256 * i128::from(UNITS_PER_256TH);
                let magnitude = (sum.abs() + unit / 2) / unit;
                let expected = if sum < 0 { -magnitude } else { magnitude };
                prop_assert_eq!(i128::from(rounded_steps(extruder.position_256ths())), expected);
                prop_assert_eq!(i128::from(extruder.position_256ths()), sum * 256 / unit);
            }
        }
    }

    #[test]
    fn filament_that_was_not_pushed_is_told() {
        let mut extruder = Extruder::new(StepsPerMm::from_f64(100.0).unwrap());
        extruder.advance(3 * FILAMENT_UNITS_PER_MM + 12_345);
        assert_eq!(extruder.reset_to(50), 25 * FILAMENT_UNITS_PER_MM / 10 + 12_345);
        assert_eq!(extruder.position_256ths(), 50 * 256);
        assert_eq!(extruder.reset_to(60), -FILAMENT_UNITS_PER_MM / 10);
        // A motor at its target keeps the fraction.
        extruder.advance(12_345);
        assert_eq!(extruder.reset_to(60), 0);
        assert_eq!(extruder.position_256ths(), 60 * 256 + 31);
    }

    /// New steps/mm apply from each position on: the motor makes the corresponding number of steps,
    /// and at most a fraction of 1/256 step is lost.
    #[test]
    fn other_steps_hold_from_where_it_stands() {
        for before in [3 * FILAMENT_UNITS_PER_MM + 12_345, -7 * FILAMENT_UNITS_PER_MM - 99] {
            let mut extruder = Extruder::new(StepsPerMm::from_f64(100.0).unwrap());
            extruder.advance(before);
            let stood = extruder.position_256ths();
            extruder.set_steps_per_mm(StepsPerMm::from_f64(104.5).unwrap());
            assert_eq!(extruder.position_256ths(), stood);
            extruder.advance(10 * FILAMENT_UNITS_PER_MM);
            assert_eq!(extruder.position_256ths(), stood + 1045 * 256);
        }
    }

    #[test]
    fn a_half_below_zero_rounds_away() {
        assert_eq!(rounded_steps(-128), -1);
        assert_eq!(rounded_steps(-127), 0);
        assert_eq!(rounded_steps(128), 1);
    }
}
