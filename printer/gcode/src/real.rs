//! Floating-point numbers as text.

use core::fmt::{self, Display, Formatter};

/// Maximum number of decimals; values to 9e6 are written exactly with them.
const MOST_DECIMALS: u8 = 9;

/// A number rounded to some decimals, halves away from zero, and zero without a sign.
///
/// The core library's formatting is exact for all numbers and any number of digits, for 20 KB of a
/// board's flash. This is exact up to 9e15 units of the last decimal, more than replies need, and
/// saturates at 1.8e19.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Real {
    value: f64,
    decimals: u8,
    is_short: bool,
}

impl Real {
    /// Number with all its decimals, 0 to 9.
    pub fn fixed(value: impl Into<f64>, decimals: u8) -> Self {
        Self { value: value.into(), decimals: decimals.min(MOST_DECIMALS), is_short: false }
    }

    /// Number with up to this many decimals, 0 to 9, without trailing zeros.
    pub fn short(value: impl Into<f64>, decimals: u8) -> Self {
        Self { is_short: true, ..Self::fixed(value, decimals) }
    }
}

impl Display for Real {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let Self { value, decimals, is_short } = *self;
        if value.is_nan() {
            return formatter.write_str("NaN");
        }
        let is_negative = value < 0.0;
        if value.is_infinite() {
            return formatter.write_str(if is_negative { "-inf" } else { "inf" });
        }
        let mut unit = 10_u64.pow(decimals.into());
        let magnitude = if is_negative { -value } else { value };
        // The conversion truncates towards zero and saturates.
        let mut units = (magnitude * unit as f64 + 0.5) as u64;
        let mut digits = usize::from(decimals);
        while is_short && digits > 0 && units.is_multiple_of(10) {
            (units, unit, digits) = (units / 10, unit / 10, digits - 1);
        }
        if is_negative && units > 0 {
            formatter.write_str("-")?;
        }
        write!(formatter, "{}", units / unit)?;
        if digits == 0 { Ok(()) } else { write!(formatter, ".{:0digits$}", units % unit) }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::format;
    use std::string::ToString;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn short_form_drops_trailing_zeros() {
        for (value, decimals, fixed, short) in [
            (0.0, 2, "0.00", "0"),
            (-0.0, 2, "0.00", "0"),
            (-0.004, 2, "0.00", "0"),
            (0.005, 2, "0.01", "0.01"),
            (-2.5, 0, "-3", "-3"),
            (1200.0, 0, "1200", "1200"),
            (300.0, 3, "300.000", "300"),
            (0.25, 6, "0.250000", "0.25"),
            (-299.99, 2, "-299.99", "-299.99"),
            (9_223_372_036.5, 6, "9223372036.500000", "9223372036.5"),
            (1e300, 0, "18446744073709551615", "18446744073709551615"),
            (f64::NAN, 2, "NaN", "NaN"),
            (f64::INFINITY, 2, "inf", "inf"),
            (f64::NEG_INFINITY, 2, "-inf", "-inf"),
        ] {
            assert_eq!(Real::fixed(value, decimals).to_string(), fixed);
            assert_eq!(Real::short(value, decimals).to_string(), short);
        }
        assert_eq!(Real::fixed(0.1_f32, 200).to_string(), "0.100000001");
    }

    proptest! {
        #[test]
        fn every_number_is_written_to_its_last_decimal(value in -1e7..1e7_f64, decimals in 0..=6_u8) {
            let text = Real::fixed(value, decimals).to_string();
            let half = 0.5 * 10_f64.powi(-i32::from(decimals));
            prop_assert!((text.parse::<f64>().unwrap() - value).abs() <= half * (1.0 + 1e-6), "{value} as {text}");
            let point = text.find('.').map_or(0, |at| text.len() - at - 1);
            prop_assert_eq!(point, usize::from(decimals));
            // The other form is the same number.
            let short = Real::short(value, decimals).to_string();
            prop_assert_eq!(format!("{:.*}", usize::from(decimals), short.parse::<f64>().unwrap()), text.clone());
            prop_assert!(!short.contains('.') || !short.ends_with('0'));
        }
    }
}
