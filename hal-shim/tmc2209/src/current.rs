//! Motor currents and the chip's scale of 32 (data sheet, section 9).

use core::fmt;

/// Full-scale voltage across the sense resistor with vsense = 0 and 1, mV (section
/// 9, table of VFS).
const FULL_SCALE_MV: [u64; 2] = [325, 180];

/// Resistance that the chip and its leads add to the sense resistor, milliohm (section 9, the
/// formula's 20 milliohm).
const INNER_MILLIOHM: u64 = 20;

/// 32 times the square root of 2, in millionths: from the effective current to the scale.
const ROOT_TWO_TIMES_32: u64 = 45_254_834;

/// mA times milliohm over mV, in thousands and millionths.
const UNITS: u64 = 1_000 * 1_000_000;

/// A current in the chip's units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CurrentScale {
    /// The share of full scale: this and one, over 32; 0 to 31.
    pub scale: u8,
    /// Full scale at 0.18 V (vsense = 1) instead of 0.325 V.
    pub high_sensitivity: bool,
}

/// A current that the chip cannot make with its sense resistor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CurrentError {
    /// The requested current, mA.
    pub current_ma: u16,
    /// Minimum, mA.
    pub least_ma: u16,
    /// Maximum, mA.
    pub most_ma: u16,
}

impl fmt::Display for CurrentError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { current_ma, least_ma, most_ma } = self;
        write!(out, "a current of {current_ma} mA is out of range, expected {least_ma} to {most_ma} mA")
    }
}

impl CurrentScale {
    /// The nearest to an effective current: scale + 1 = 32 sqrt(2) I (R + 20 milliohm) / VFS
    /// (section 9). Full scale is the smaller one wherever that reaches, for then the steps between
    /// currents are finer.
    ///
    /// # Errors
    /// It is more than the larger full scale gives, or less than half the least.
    pub fn from_ma(current_ma: u16, sense_milliohm: u16) -> Result<Self, CurrentError> {
        let milliohm = u64::from(sense_milliohm) + INNER_MILLIOHM;
        let share = ROOT_TWO_TIMES_32 * u64::from(current_ma) * milliohm;
        for high_sensitivity in [true, false] {
            let whole = UNITS * FULL_SCALE_MV[usize::from(high_sensitivity)];
            let nearest = (share + whole / 2) / whole;
            if (1..=32).contains(&nearest) {
                return Ok(Self { scale: nearest as u8 - 1, high_sensitivity });
            }
            if nearest == 0 {
                break;
            }
        }
        let least_ma = Self { scale: 0, high_sensitivity: true }.current_ma(sense_milliohm);
        let most_ma = Self { scale: 31, high_sensitivity: false }.current_ma(sense_milliohm);
        Err(CurrentError { current_ma, least_ma, most_ma })
    }

    /// The effective current, mA, rounded.
    #[must_use]
    pub fn current_ma(self, sense_milliohm: u16) -> u16 {
        let milliohm = u64::from(sense_milliohm) + INNER_MILLIOHM;
        let whole = UNITS * FULL_SCALE_MV[usize::from(self.high_sensitivity)];
        let divisor = ROOT_TWO_TIMES_32 * milliohm;
        let current = ((u64::from(self.scale) + 1) * whole + divisor / 2) / divisor;
        current.min(u64::from(u16::MAX)) as u16
    }

    /// A share of this current in percent, on the same full scale, and at least the least.
    #[must_use]
    pub fn percent(self, percent: u8) -> Self {
        let share = ((u16::from(self.scale) + 1) * u16::from(percent.min(100)) + 50) / 100;
        Self { scale: share.clamp(1, 32) as u8 - 1, ..self }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    /// The formula of section 9 as written there.
    fn formula_ma(scale: u8, full_scale_v: f64, sense_ohm: f64) -> f64 {
        (f64::from(scale) + 1.0) / 32.0 * full_scale_v / (sense_ohm + 0.020) / 2.0_f64.sqrt() * 1000.0
    }

    #[test]
    fn figures_of_the_data_sheet() {
        // Section 9, table of sense resistors: 0.11 ohm gives 1.77 A at most, 0.22 ohm 0.96 A,
        // with vsense = 0.
        let most = CurrentScale { scale: 31, high_sensitivity: false };
        assert_eq!([most.current_ma(110), most.current_ma(220)], [1768, 958]);
        // The Prusa MINI's 350 mA at 0.22 ohm.
        let mini = CurrentScale::from_ma(350, 220).unwrap();
        assert_eq!(mini, CurrentScale { scale: 20, high_sensitivity: true });
        assert_eq!(mini.current_ma(220), 348);
        assert_eq!(
            CurrentScale::from_ma(1000, 220),
            Err(CurrentError { current_ma: 1000, least_ma: 17, most_ma: 958 })
        );
        assert!(CurrentScale::from_ma(0, 110).is_err());
        assert_eq!(mini.percent(50).scale, 10);
        assert_eq!(mini.percent(0).scale, 0);
    }

    proptest! {
        #[test]
        fn the_formula_holds(scale in 0u8..32, high_sensitivity: bool, sense in 50u16..1000) {
            let volts = if high_sensitivity { 0.18 } else { 0.325 };
            let expected = formula_ma(scale, volts, f64::from(sense) / 1000.0);
            let found = CurrentScale { scale, high_sensitivity }.current_ma(sense);
            prop_assert!((f64::from(found) - expected).abs() <= 0.51, "{found} {expected}");
        }

        #[test]
        fn the_nearest_current_is_taken(current in 0u16..4000, sense in 50u16..1000) {
            let step = formula_ma(0, 0.325, f64::from(sense) / 1000.0);
            match CurrentScale::from_ma(current, sense) {
                Ok(scale) => {
                    let off = (f64::from(scale.current_ma(sense)) - f64::from(current)).abs();
                    prop_assert!(off <= step / 2.0 + 1.0, "{current} {scale:?}");
                }
                Err(error) => prop_assert!(current < error.least_ma || current > error.most_ma, "{error}"),
            }
        }
    }
}
