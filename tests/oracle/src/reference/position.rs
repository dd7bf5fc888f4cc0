//! Positions of the motors: exact products, rounded once.

use super::decimal::{Decimal, UNITS_PER_MM, divide_rounded};
use super::job::EXTRUDER_FRACTIONS_PER_UNIT;
use super::profile::{Kinematics, ReferenceProfile};

/// Turns positions into steps for one machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorScale {
    kinematics: Kinematics,
    steps_per_mm: [Decimal; 4],
}

/// The extruder's motor as a fraction of steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExtruderSteps {
    /// The step nearest to it, half away from zero: the motor's right position.
    pub rounded: i64,
    /// The exact position to f64's precision, in steps.
    pub exact: f64,
}

impl MotorScale {
    /// The scale of a profile.
    pub fn new(profile: &ReferenceProfile) -> Self {
        Self { kinematics: profile.kinematics, steps_per_mm: profile.steps_per_mm }
    }

    /// Steps of the three motors at a position: the exact product of each one's coordinate
    /// with its own steps/mm, rounded half away from zero; on CoreXY A = round((x+y)*s) and
    /// B = round((x-y)*s).
    pub fn motors(&self, position_10nm: [i64; 3]) -> [i64; 3] {
        let coordinates = self.kinematics.motors(position_10nm.map(i128::from));
        let mut steps = [0; 3];
        for ((steps, coordinate), scale) in steps.iter_mut().zip(coordinates).zip(self.steps_per_mm) {
            let (numerator, denominator) = scale.ratio();
            *steps = narrow(divide_rounded(coordinate * numerator, denominator * i128::from(UNITS_PER_MM)));
        }
        steps
    }

    /// The extruder's motor at a total in 1/100 of 10 nm (see [`EXTRUDER_FRACTIONS_PER_UNIT`]).
    pub fn extruder(&self, total: i128) -> ExtruderSteps {
        let [.., scale] = self.steps_per_mm;
        let (numerator, denominator) = scale.ratio();
        let denominator = denominator * i128::from(UNITS_PER_MM) * EXTRUDER_FRACTIONS_PER_UNIT;
        let product = total.saturating_mul(numerator);
        let rounded = divide_rounded(product, denominator);
        // The small difference is exact; the whole would lose the fraction's last
        // digits far from zero.
        let remainder = product - rounded * denominator;
        ExtruderSteps { rounded: narrow(rounded), exact: rounded as f64 + remainder as f64 / denominator as f64 }
    }
}

/// Steps fit an i64 for every position the interpreter lets through; saturate all the same.
fn narrow(steps: i128) -> i64 {
    i64::try_from(steps).unwrap_or(if steps < 0 { i64::MIN } else { i64::MAX })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_rounded_half_away_from_zero() {
        let scale = MotorScale::new(&ReferenceProfile::cartesian());
        // 0.00625 mm at 80 steps/mm is half a step.
        assert_eq!(scale.motors([625, -625, 125]), [1, -1, 1]);
        assert_eq!(scale.motors([624, -624, 124]), [0, 0, 0]);
        assert_eq!(scale.motors([8_715_300, 0, 20_000]), [6972, 0, 80]);
    }

    #[test]
    fn corexy_rounds_sum_and_difference() {
        let scale = MotorScale::new(&ReferenceProfile::corexy());
        // (0.002 + 0.0015) * 160 = 0.56; (0.002 - 0.0015) * 160 = 0.08: rounding x and y first
        // would give B = 0 too, but A = 0.
        assert_eq!(scale.motors([200, 150, 0]), [1, 0, 0]);
        assert_eq!(scale.motors([30_000_000, 30_000_000, 0]), [96_000, 0, 0]);
        assert_eq!(scale.motors([0, 30_000_000, 0]), [48_000, -48_000, 0]);
    }

    #[test]
    fn the_extruder_keeps_its_fraction() {
        let scale = MotorScale::new(&ReferenceProfile::cartesian());
        // 0.05511 mm at 100 % and 95 steps/mm: 5.23545 steps.
        let steps = scale.extruder(5511 * 100);
        assert_eq!(steps.rounded, 5);
        assert!((steps.exact - 5.23545).abs() < 1e-12);
        // Ten of them are 52.3545 steps and not ten times five.
        assert_eq!(scale.extruder(5511 * 1000).rounded, 52);
        assert_eq!(scale.extruder(-5511 * 1000).rounded, -52);
    }
}
