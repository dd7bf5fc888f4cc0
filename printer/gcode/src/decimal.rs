//! Decimal numbers as G-code writes them, kept exact.

use core::fmt;
use core::num::NonZeroU64;

/// Units of a [`Decimal`] in one.
const NANOS_PER_UNIT: i64 = 1_000_000_000;
/// Fractional digits a [`Decimal`] keeps.
const FRACTION_DIGITS: usize = 9;
/// Largest whole part that leaves room for the fraction.
const MAX_WHOLE: u64 = (i64::MAX / NANOS_PER_UNIT) as u64;
/// Converts units of 1e-9 to the stored unit.
const SIGN: u64 = 1 << 63;
/// Factors that turn a fraction with this many digits into units of 1e-9.
const FRACTION_SCALE: [u32; FRACTION_DIGITS + 1] =
    [1_000_000_000, 100_000_000, 10_000_000, 1_000_000, 100_000, 10_000, 1_000, 100, 10, 1];

/// A decimal number, exact in units of 1e-9, from -9 223 372 036.85 to 9 223 372 036.85.
///
/// Slicers write three to five fractional digits; digits after the ninth are dropped. Whether the
/// number means millimetres, inches or seconds depends on the command.
// The units plus 2^63, which keeps their order and leaves zero for `None`: a command has up to
// seven numbers that may be missing, and each takes 8 bytes so, not 16.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Decimal(NonZeroU64);

impl fmt::Debug for Decimal {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Decimal({})", self.nanos())
    }
}

impl Default for Decimal {
    fn default() -> Self {
        Decimal::ZERO
    }
}

/// Reason why a text is not a [`Decimal`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberError {
    /// The text is not of the form `5`, `-.8`, `1.` or `+3.25`; exponents are not
    /// numbers in G-code.
    NotANumber,
    /// The number is beyond +-9 223 372 036.
    TooLarge,
}

impl fmt::Display for NumberError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            NumberError::NotANumber => "not a number",
            NumberError::TooLarge => "too large",
        })
    }
}

impl core::error::Error for NumberError {}

impl Decimal {
    /// Zero.
    pub const ZERO: Decimal = Decimal::from_nanos(0);

    /// The number with this many units of 1e-9; `i64::MIN` counts as its neighbour.
    pub const fn from_nanos(nanos: i64) -> Self {
        Decimal(match NonZeroU64::new(nanos.cast_unsigned() ^ SIGN) {
            Some(biased) => biased,
            None => NonZeroU64::MIN,
        })
    }

    /// The number in units of 1e-9.
    pub const fn nanos(self) -> i64 {
        (self.0.get() ^ SIGN).cast_signed()
    }

    /// Reads a number that fills `text` from its first byte to its last: `5`, `-.8`, `1.`, `+3`.
    ///
    /// # Errors
    ///
    /// [`NumberError::NotANumber`] for any other form, the empty one included;
    /// [`NumberError::TooLarge`] beyond the range.
    pub fn parse(text: &[u8]) -> Result<Self, NumberError> {
        match Self::parse_prefix(text) {
            (length, number) if length == text.len() => number,
            _ => Err(NumberError::NotANumber),
        }
    }

    /// Reads the number at the start of `text`. Returns the length of the longest run of signs,
    /// digits and points there, and its value.
    pub(crate) fn parse_prefix(text: &[u8]) -> (usize, Result<Self, NumberError>) {
        let negative = text.first() == Some(&b'-');
        let start = usize::from(negative || text.first() == Some(&b'+'));
        let (head, head_digits) = leading_digits(text, start);
        let mut at = start + head_digits;
        let mut whole = u64::from(head);
        while head_digits == FRACTION_DIGITS
            && let Some(digit) = digit_at(text, at)
        {
            // The value no longer matters beyond the limit.
            if whole <= MAX_WHOLE {
                whole = whole * 10 + u64::from(digit);
            }
            at += 1;
        }
        let mut digits = at - start;
        let (mut fraction, mut kept) = (0, 0);
        if text.get(at) == Some(&b'.') {
            at += 1;
            (fraction, kept) = leading_digits(text, at);
            at += kept;
            digits += kept;
            while kept == FRACTION_DIGITS && digit_at(text, at).is_some() {
                at += 1;
            }
        }
        let run_goes_on = |at: usize| matches!(text.get(at), Some(b'0'..=b'9' | b'.' | b'+' | b'-'));
        if digits == 0 || run_goes_on(at) {
            while run_goes_on(at) {
                at += 1;
            }
            return (at, Err(NumberError::NotANumber));
        }
        if whole > MAX_WHOLE {
            return (at, Err(NumberError::TooLarge));
        }
        let fraction_nanos = u64::from(fraction) * u64::from(FRACTION_SCALE[kept]);
        let nanos = whole * NANOS_PER_UNIT as u64 + fraction_nanos;
        let number = match i64::try_from(nanos) {
            Ok(nanos) if negative => Ok(Decimal::from_nanos(-nanos)),
            Ok(nanos) => Ok(Decimal::from_nanos(nanos)),
            Err(_) => Err(NumberError::TooLarge),
        };
        (at, number)
    }

    /// A length in millimetres as units of 10 nm, halves away from zero.
    pub const fn to_10nm_from_mm(self) -> i64 {
        const DIVISOR: u64 = 10_000;
        const RECIPROCAL: u64 = u64::MAX / DIVISOR;
        // Every coordinate is converted here, and the board divides 64 bits in software. The
        // truncated reciprocal makes the quotient right or one short.
        let magnitude = self.nanos().unsigned_abs() + DIVISOR / 2;
        let mut quotient = upper_half_of_product(magnitude, RECIPROCAL);
        if magnitude - quotient * DIVISOR >= DIVISOR {
            quotient += 1;
        }
        if self.nanos() < 0 { -(quotient as i64) } else { quotient as i64 }
    }

    /// A length in inches (25.4 mm) as units of 10 nm, halves away from zero.
    ///
    /// Every number in range fits; with the `Option`, callers need not know the range.
    pub const fn to_10nm_from_inches(self) -> Option<i64> {
        // nanos * 25.4 / 10^4 = nanos * 254 / 10^5, in two parts so that 64 bits are enough.
        let (quotient, remainder) = (self.nanos() / 100_000, self.nanos() % 100_000);
        match quotient.checked_mul(254) {
            Some(whole) => whole.checked_add(divide_half_away(remainder * 254, 100_000)),
            None => None,
        }
    }

    /// The nearest `f64` (within 9e6 of zero; beyond, one unit in the last place may be off).
    pub fn to_f64(self) -> f64 {
        self.nanos() as f64 / NANOS_PER_UNIT as f64
    }

    /// The number as an integer; `None` if it has a fraction.
    pub const fn to_i64_exact(self) -> Option<i64> {
        if self.nanos() % NANOS_PER_UNIT == 0 { Some(self.nanos() / NANOS_PER_UNIT) } else { None }
    }

    /// The number without its fraction.
    pub const fn to_i64_towards_zero(self) -> i64 {
        self.nanos() / NANOS_PER_UNIT
    }

    /// The nearest integer to `self * factor`, halves away from zero; `factor` is
    /// one of 1 and 1000.
    pub(crate) const fn round_scaled(self, factor: i64) -> i64 {
        divide_half_away(self.nanos(), NANOS_PER_UNIT / factor)
    }

    /// True if the number is below zero.
    pub const fn is_negative(self) -> bool {
        self.nanos() < 0
    }
}

impl fmt::Display for Decimal {
    /// The shortest text that reads back as the same number.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let magnitude = self.nanos().unsigned_abs();
        let (whole, mut fraction) = (magnitude / NANOS_PER_UNIT as u64, magnitude % NANOS_PER_UNIT as u64);
        let sign = if self.is_negative() { "-" } else { "" };
        write!(formatter, "{sign}{whole}")?;
        if fraction == 0 {
            return Ok(());
        }
        let mut width = FRACTION_DIGITS;
        while fraction.is_multiple_of(10) {
            fraction /= 10;
            width -= 1;
        }
        write!(formatter, ".{fraction:0width$}")
    }
}

/// The value and the count of the digits from a place on; at most nine digits,
/// which fit in 32 bits.
#[inline(always)]
fn leading_digits(text: &[u8], from: usize) -> (u32, usize) {
    let (mut number, mut digits) = (0u32, 0);
    for byte in text.get(from..).unwrap_or_default().iter().take(FRACTION_DIGITS) {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            break;
        }
        number = number.wrapping_mul(10).wrapping_add(u32::from(digit));
        digits += 1;
    }
    (number, digits)
}

/// The value of the digit at `at`, if there is one.
#[inline]
fn digit_at(text: &[u8], at: usize) -> Option<u8> {
    let digit = text.get(at)?.wrapping_sub(b'0');
    (digit <= 9).then_some(digit)
}

/// The upper 64 of the 128 bits of a product.
const fn upper_half_of_product(a: u64, b: u64) -> u64 {
    let ((a_high, a_low), (b_high, b_low)) = ((a >> 32, a & 0xFFFF_FFFF), (b >> 32, b & 0xFFFF_FFFF));
    let middle = a_high * b_low + ((a_low * b_low) >> 32);
    let carried = a_low * b_high + (middle & 0xFFFF_FFFF);
    a_high * b_high + (middle >> 32) + (carried >> 32)
}

/// `value / divisor`, halves away from zero; `divisor` is even and positive.
pub(crate) const fn divide_half_away(value: i64, divisor: i64) -> i64 {
    let (quotient, remainder) = (value / divisor, value % divisor);
    if remainder.unsigned_abs() >= divisor.unsigned_abs() / 2 { quotient + value.signum() } else { quotient }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    fn nanos(text: &str) -> Result<i64, NumberError> {
        Decimal::parse(text.as_bytes()).map(Decimal::nanos)
    }

    #[test]
    fn forms_that_slicers_write() {
        for (text, expected) in [
            ("5", 5_000_000_000),
            ("-.8", -800_000_000),
            (".2", 200_000_000),
            ("1.", 1_000_000_000),
            ("+3", 3_000_000_000),
            ("007.50", 7_500_000_000),
            ("-0", 0),
            ("87.153", 87_153_000_000),
            (".03647", 36_470_000),
            ("0.1234567899", 123_456_789),
            ("9223372036.854775807", i64::MAX),
            ("-9223372036.854775807", -i64::MAX),
        ] {
            assert_eq!(nanos(text), Ok(expected), "{text}");
        }
    }

    #[test]
    fn forms_that_are_not_numbers() {
        for text in ["", ".", "-", "+", "-.", "1.2.3", "1-2", "--1", "+-1", "1e5", "0x10", " 1", "1 ", "a", "1,5"] {
            assert_eq!(nanos(text), Err(NumberError::NotANumber), "{text:?}");
        }
        for text in ["9223372037", "-9223372037", "9223372036.854775808", "99999999999999999999999999"] {
            assert_eq!(nanos(text), Err(NumberError::TooLarge), "{text:?}");
        }
    }

    #[test]
    fn lengths_round_half_away_from_zero() {
        let mm = |text: &str| Decimal::parse(text.as_bytes()).unwrap().to_10nm_from_mm();
        assert_eq!(mm("87.153"), 8_715_300);
        assert_eq!(mm("0.000005"), 1);
        assert_eq!(mm("-0.000005"), -1);
        assert_eq!(mm("0.000004999"), 0);
        assert_eq!(Decimal::from_nanos(i64::MAX).to_10nm_from_mm(), 922_337_203_685_478);
        let inches = |text: &str| Decimal::parse(text.as_bytes()).unwrap().to_10nm_from_inches().unwrap();
        assert_eq!(inches("1"), 2_540_000);
        assert_eq!(inches("-0.5"), -1_270_000);
        assert_eq!(inches("0.0000125"), 32); // 31.75
        assert_eq!(inches("0.00000125"), 3); // 3.175
    }

    #[test]
    fn display_is_the_shortest_form() {
        for text in ["0", "5", "-0.8", "300", "0.000000001", "-12.03", "9223372036.854775807"] {
            assert_eq!(Decimal::parse(text.as_bytes()).unwrap().to_string(), text);
        }
        let (lowest, next) = (Decimal::from_nanos(i64::MIN), Decimal::from_nanos(-i64::MAX));
        assert_eq!(lowest, next);
        assert_eq!(next.to_string(), "-9223372036.854775807");
        assert!(lowest < Decimal::ZERO && Decimal::ZERO < Decimal::from_nanos(1));
        assert_eq!(size_of::<Option<Decimal>>(), 8);
    }

    /// Rounds `numerator / denominator` half away from zero in 128 bits.
    fn reference_round(numerator: i128, denominator: i128) -> i128 {
        (numerator.abs() * 2 + denominator) / (denominator * 2) * numerator.signum()
    }

    proptest! {
        #[test]
        fn agrees_with_a_128_bit_reference(
            sign in "[+-]?", whole in "[0-9]{0,12}", fraction in proptest::option::of("[0-9]{0,12}")
        ) {
            let text = match &fraction {
                Some(fraction) => format!("{sign}{whole}.{fraction}"),
                None => format!("{sign}{whole}"),
            };
            let digits = fraction.clone().unwrap_or_default();
            let expected = if whole.is_empty() && digits.is_empty() {
                Err(NumberError::NotANumber)
            } else {
                let kept: String = format!("{digits:0<9}").chars().take(9).collect();
                let magnitude: i128 = format!("0{whole}{kept}").parse().unwrap();
                let value = if sign == "-" { -magnitude } else { magnitude };
                if magnitude > i128::from(i64::MAX) { Err(NumberError::TooLarge) } else { Ok(value as i64) }
            };
            prop_assert_eq!(nanos(&text), expected);
        }

        #[test]
        fn conversions_agree_with_a_128_bit_reference(value in any::<i64>()) {
            let number = Decimal::from_nanos(value);
            let wide = i128::from(value);
            prop_assert_eq!(i128::from(number.to_10nm_from_mm()), reference_round(wide, 10_000));
            prop_assert_eq!(
                number.to_10nm_from_inches().map(i128::from),
                Some(reference_round(wide * 254, 100_000))
            );
            prop_assert_eq!(i128::from(number.round_scaled(1000)), reference_round(wide, 1_000_000));
            let whole = value / 1_000_000_000;
            prop_assert_eq!(Decimal::from_nanos(whole * 1_000_000_000).to_i64_exact(), Some(whole));
            prop_assert_eq!(
                number.to_i64_exact().is_some(), wide.rem_euclid(1_000_000_000) == 0
            );
        }

        #[test]
        fn display_reads_back(value in -i64::MAX..=i64::MAX) {
            let number = Decimal::from_nanos(value);
            prop_assert_eq!(Decimal::parse(number.to_string().as_bytes()), Ok(number));
        }

        #[test]
        fn to_f64_is_the_nearest(value in -9_000_000_000_000_000i64..9_000_000_000_000_000) {
            let number = Decimal::from_nanos(value);
            prop_assert_eq!(number.to_f64(), number.to_string().parse::<f64>().unwrap());
        }

        #[test]
        fn any_bytes_are_answered(bytes in proptest::collection::vec(any::<u8>(), 0..40)) {
            let (length, number) = Decimal::parse_prefix(&bytes);
            prop_assert!(length <= bytes.len());
            prop_assert!(number.is_err() || length > 0);
        }
    }
}
