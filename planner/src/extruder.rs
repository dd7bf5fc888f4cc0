//! Where the filament is: an exact sum, handed out in 1/256 steps.

use crate::kinematics::StepsPerMm;

/// Units of filament in a millimetre: 0.1 nm, so that a length of 10 nm times a flow in percent is exact.
pub const FILAMENT_UNITS_PER_MM: i64 = 10_000_000;

/// A unit of filament times a unit of [`StepsPerMm`], a step's worth of them.
const UNITS_PER_STEP: i64 = FILAMENT_UNITS_PER_MM * 100_000;

/// The extruder's exact position, the sum of all its deltas, in whole steps and a remainder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extruder {
    steps_per_mm: StepsPerMm,
    whole_steps: i64,
    /// 0 to [`UNITS_PER_STEP`] - 1, also below zero.
    remainder: i64,
}

impl Extruder {
    /// An extruder that stands at zero.
    pub const fn new(steps_per_mm: StepsPerMm) -> Self {
        Self { steps_per_mm, whole_steps: 0, remainder: 0 }
    }

    /// The longest single delta, in units of 0.1 nm: 1 m, or less where the product would leave 64 bits.
    pub fn longest_move_100pm(&self) -> i64 {
        (4_000_000_000_000_000_000 / self.steps_per_mm.hundred_thousandths()).min(1_000 * FILAMENT_UNITS_PER_MM)
    }

    /// Adds a delta in units of 0.1 nm, at most [`Self::longest_move_100pm`] either way (longer ones are cut there).
    pub fn advance(&mut self, delta_100pm: i64) {
        let longest = self.longest_move_100pm();
        let sum = self.remainder + delta_100pm.clamp(-longest, longest) * self.steps_per_mm.hundred_thousandths();
        self.whole_steps += sum.div_euclid(UNITS_PER_STEP);
        self.remainder = sum.rem_euclid(UNITS_PER_STEP);
    }

    /// Position in 1/256 steps, cut towards zero.
    ///
    /// Cut, not rounded: [`rounded_steps`] of the cut value is then always the rounding of the exact one (nested
    /// floors), which rounding twice would miss.
    pub fn position_256ths(&self) -> i64 {
        let parts = self.remainder * 256;
        let cut_upwards = i64::from(self.whole_steps < 0 && parts % UNITS_PER_STEP != 0);
        self.whole_steps * 256 + parts / UNITS_PER_STEP + cut_upwards
    }

    /// The motor stands at this step after an abandoned move. Returns the filament between there and where it would have
    /// gone, units of 0.1 nm; nothing, fractions of a step included, where that is the same step.
    pub fn stand_at(&mut self, steps: i64) -> i64 {
        if rounded_steps(self.position_256ths()) == steps {
            return 0;
        }
        let whole = i128::from(self.whole_steps) - i128::from(steps);
        let missing = whole * i128::from(UNITS_PER_STEP) + i128::from(self.remainder);
        self.whole_steps = steps;
        self.remainder = 0;
        (missing / i128::from(self.steps_per_mm.hundred_thousandths())) as i64
    }
}

/// The motor step of a position in 1/256 steps: nearest, halves away from zero.
pub const fn rounded_steps(position_256ths: i64) -> i64 {
    if position_256ths < 0 { -((128 - position_256ths) >> 8) } else { (position_256ths + 128) >> 8 }
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
                let unit = i128::from(UNITS_PER_STEP);
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
        assert_eq!(extruder.stand_at(50), 25 * FILAMENT_UNITS_PER_MM / 10 + 12_345);
        assert_eq!(extruder.position_256ths(), 50 * 256);
        assert_eq!(extruder.stand_at(60), -FILAMENT_UNITS_PER_MM / 10);
        // Standing where it should keeps the fraction.
        extruder.advance(12_345);
        assert_eq!(extruder.stand_at(60), 0);
        assert_eq!(extruder.position_256ths(), 60 * 256 + 31);
    }

    #[test]
    fn a_half_below_zero_rounds_away() {
        assert_eq!(rounded_steps(-128), -1);
        assert_eq!(rounded_steps(-127), 0);
        assert_eq!(rounded_steps(128), 1);
    }
}
