//! Decimal text as an exact number.

/// Units of position in a millimetre: one unit is 10 nm.
pub const UNITS_PER_MM: i64 = 100_000;

/// Fraction digits kept. Cutting the rest cannot change a result that is rounded half away from
/// zero at an earlier digit: a cut number stays on its side of the tie, and on the tie it is
/// rounded up like the whole number.
const FRACTION_DIGITS: u32 = 12;

/// Largest magnitude accepted before the decimal point. With it no product in this
/// crate leaves an i128.
const INTEGER_MAX: i128 = 1_000_000_000;

/// An exact decimal number: `mantissa / 10^scale`, of magnitude below 10^9 + 1, with at most 12
/// fraction digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decimal {
    mantissa: i128,
    scale: u32,
}

/// The number is larger than any coordinate, feed or limit can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfRange;

impl Decimal {
    /// Reads the longest decimal number at the start of `text`: sign, digits, point, digits. No
    /// exponent: in G-code `E` begins the next word. `None` without a digit.
    ///
    /// # Errors
    /// `OutOfRange` if the integer part exceeds 10^9.
    pub fn parse_prefix(text: &[u8]) -> Result<Option<Self>, OutOfRange> {
        let (negative, text) = match text.split_first() {
            Some((b'-', rest)) => (true, rest),
            Some((b'+', rest)) => (false, rest),
            _ => (false, text),
        };
        let (mut mantissa, mut scale, mut digits, mut in_fraction) = (0i128, 0u32, 0u32, false);
        for &byte in text {
            match byte {
                b'0'..=b'9' => {
                    digits = digits.saturating_add(1);
                    if in_fraction && scale == FRACTION_DIGITS {
                        continue;
                    }
                    mantissa = mantissa * 10 + i128::from(byte - b'0');
                    if in_fraction {
                        scale += 1;
                    } else if mantissa > INTEGER_MAX {
                        return Err(OutOfRange);
                    }
                }
                b'.' if !in_fraction => in_fraction = true,
                _ => break,
            }
        }
        if digits == 0 {
            return Ok(None);
        }
        Ok(Some(Self { mantissa: if negative { -mantissa } else { mantissa }, scale }))
    }

    /// The decimal number that Rust prints for `value`: the shortest that reads back as it. That is
    /// the number a person wrote in a profile. `None` if `value` is not finite or is out of range.
    pub fn from_f64(value: f64) -> Option<Self> {
        if !value.is_finite() {
            return None;
        }
        Self::parse_prefix(format!("{value}").as_bytes()).ok().flatten()
    }

    /// A whole number.
    pub fn from_integer(value: u32) -> Self {
        Self { mantissa: i128::from(value), scale: 0 }
    }

    /// `self * factor`, rounded half away from zero.
    pub fn times_rounded(self, factor: i64) -> i128 {
        divide_rounded(self.mantissa * i128::from(factor), 10i128.pow(self.scale))
    }

    /// The nearest f64.
    pub fn to_f64(self) -> f64 {
        self.mantissa as f64 / 10f64.powi(self.scale as i32)
    }

    /// The numerator and the (positive) denominator of the number.
    pub fn ratio(self) -> (i128, i128) {
        (self.mantissa, 10i128.pow(self.scale))
    }

    /// The integer part, the fraction cut off.
    pub fn truncated(self) -> i64 {
        // Below 10^9 + 1 by construction.
        (self.mantissa / 10i128.pow(self.scale)) as i64
    }
}

/// `numerator / denominator` rounded half away from zero; `denominator` > 0.
pub fn divide_rounded(numerator: i128, denominator: i128) -> i128 {
    let quotient = numerator / denominator;
    let remainder = numerator % denominator;
    // Doubling the remainder could overflow; the difference to the denominator cannot.
    if remainder.abs() >= denominator - remainder.abs() { quotient + numerator.signum() } else { quotient }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn units(text: &str) -> i128 {
        Decimal::parse_prefix(text.as_bytes()).unwrap().unwrap().times_rounded(UNITS_PER_MM)
    }

    #[test]
    fn text_becomes_units_of_10_nm_exactly() {
        assert_eq!(units("87.153"), 8_715_300);
        assert_eq!(units("-.8"), -80_000);
        assert_eq!(units(".2"), 20_000);
        assert_eq!(units("+3."), 300_000);
        assert_eq!(units("0.00001"), 1);
        assert_eq!(units("0.000005"), 1);
        assert_eq!(units("-0.000005"), -1);
        assert_eq!(units("0.00000499999999999"), 0);
        assert_eq!(units("10E5"), 1_000_000);
        assert_eq!(units("1.2.3"), 120_000);
    }

    #[test]
    fn what_is_not_a_number_is_none_and_what_is_too_large_is_an_error() {
        for text in ["", "-", ".", "-.", "X", " 1"] {
            assert_eq!(Decimal::parse_prefix(text.as_bytes()), Ok(None), "{text:?}");
        }
        assert_eq!(Decimal::parse_prefix(b"1000000001"), Err(OutOfRange));
        assert_eq!(Decimal::parse_prefix(&[b'9'; 500]), Err(OutOfRange));
        assert!(Decimal::parse_prefix(&[b'0'; 500]).unwrap().is_some());
    }

    #[test]
    fn division_rounds_half_away_from_zero() {
        for (numerator, expected) in [(5, 1), (-5, -1), (4, 0), (-4, 0), (15, 2), (-15, -2), (14, 1), (0, 0)] {
            assert_eq!(divide_rounded(numerator, 10), expected, "{numerator}/10");
        }
        assert_eq!(divide_rounded(1, 3), 0);
        assert_eq!(divide_rounded(2, 3), 1);
    }

    #[test]
    fn a_float_from_a_profile_is_the_number_that_was_written() {
        assert_eq!(Decimal::from_f64(415.1).unwrap().ratio(), (4151, 10));
        assert_eq!(Decimal::from_f64(80.0).unwrap().ratio(), (80, 1));
        assert_eq!(Decimal::from_f64(f64::NAN), None);
        assert_eq!(Decimal::from_f64(1e300), None);
    }
}
