//! Numbers with a fraction, as text.

use core::fmt::{self, Display, Formatter};

/// Digits behind the point, at most.
const MOST_DECIMALS: u8 = 6;

/// From here on there is no telling how large a number is: no word, limit or reading is, and its digits would not all be right.
const TOO_LARGE: f64 = 1e9;

/// A number as text, halves rounded away from zero, and zero without a sign.
///
/// What is not finite is written as such: hosts then find no temperature there, rather than a wrong one. `core` prints any
/// number exactly, and takes a twelfth of the image for it.
///
/// ```
/// use ferrostep_gcode::Real;
///
/// assert_eq!(Real::fixed(2.345, 2).to_string(), "2.35");
/// assert_eq!(Real::short(300.5).to_string(), "300.5");
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Real {
    value: f64,
    decimals: u8,
    is_short: bool,
}

impl Real {
    /// With so many decimals, 6 at most.
    pub const fn fixed(value: f64, decimals: u8) -> Self {
        let decimals = if decimals < MOST_DECIMALS { decimals } else { MOST_DECIMALS };
        Self { value, decimals, is_short: false }
    }

    /// With as many decimals as it has, 6 at most.
    pub const fn short(value: f64) -> Self {
        Self { value, decimals: MOST_DECIMALS, is_short: true }
    }
}

impl Display for Real {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let Self { value, mut decimals, is_short } = *self;
        if value.is_nan() {
            return formatter.write_str("NaN");
        }
        let magnitude = value.abs();
        if magnitude >= TOO_LARGE {
            let text = if magnitude.is_infinite() { "inf" } else { "1000000000 or more" };
            return write!(formatter, "{}{text}", if value < 0.0 { "-" } else { "" });
        }
        let scale = 10u64.pow(u32::from(decimals));
        // Below 2^53, so that each is a number of its own. The conversion cuts.
        let digits = (magnitude * scale as f64 + 0.5) as u64;
        let (whole, mut fraction) = (digits / scale, digits % scale);
        while is_short && decimals > 0 && fraction.is_multiple_of(10) {
            fraction /= 10;
            decimals -= 1;
        }
        let sign = if value < 0.0 && digits > 0 { "-" } else { "" };
        write!(formatter, "{sign}{whole}")?;
        if decimals > 0 { write!(formatter, ".{fraction:0width$}", width = usize::from(decimals)) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_as_hosts_read_them() {
        for (real, text) in [
            (Real::fixed(21.3, 2), "21.30"),
            (Real::fixed(-0.004, 2), "0.00"),
            (Real::fixed(-0.005, 2), "-0.01"),
            (Real::fixed(0.037_418_25, 6), "0.037418"),
            (Real::fixed(2.5, 0), "3"),
            (Real::fixed(99.995_01, 2), "100.00"),
            (Real::fixed(1.0, 200), "1.000000"),
            (Real::short(0.0), "0"),
            (Real::short(-0.0), "0"),
            (Real::short(275.0), "275"),
            (Real::short(-0.3), "-0.3"),
            (Real::short(f64::from(0.1_f32)), "0.1"),
            (Real::short(1e-7), "0"),
            (Real::short(999_999_999.5), "999999999.5"),
            (Real::short(1e12), "1000000000 or more"),
            (Real::short(f64::MIN), "-1000000000 or more"),
            (Real::fixed(f64::INFINITY, 2), "inf"),
            (Real::fixed(f64::NEG_INFINITY, 2), "-inf"),
            (Real::fixed(f64::NAN, 2), "NaN"),
        ] {
            assert_eq!(real.to_string(), text, "{real:?}");
        }
    }

    proptest! {
        /// Beside the printing of `core`, which is exact: the same but for the rounding of what is half to the last bits.
        #[test]
        fn a_number_reads_as_what_it_is(value in -1e9..1e9, decimals in 0..=6u8) {
            let text = Real::fixed(value, decimals).to_string();
            let places = text.split_once('.').map_or(0, |(_, places)| places.len());
            prop_assert_eq!(places, usize::from(decimals));
            let step = 10f64.powi(-i32::from(decimals));
            let error = (text.parse::<f64>().unwrap_or(f64::NAN) - value).abs();
            // 2^-53 of the product, and as much of the number that the text is read as.
            prop_assert!(error <= step / 2.0 + value.abs() * 3e-16, "{value} is {text}");
        }

        #[test]
        fn a_short_number_is_the_fixed_one_without_its_zeros(thousandths in -1_000_000_000..1_000_000_000i64) {
            let value = thousandths as f64 / 1000.0;
            // `core` prints the shortest digits that make the same number.
            prop_assert_eq!(Real::short(value).to_string(), value.to_string());
        }
    }
}
