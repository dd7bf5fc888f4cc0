//! MZV with any number of impulses over any time (Klipper since 2026).
//!
//! With n impulses over t damped periods the response is zero at 1 + i / tau times the frequency,
//! for i from 0 to n - 2, where tau = t (n - 2) / (n - 2 t - 1). On the unit circle these zeros
//! are at equal angles, from 2 pi t / (n - 1) to as much before a whole turn: in pairs, with one
//! at half a turn if their number is odd. The weights are the coefficients of the polynomial that
//! has these zeros.

use super::kernel::MAX_IMPULSES;

/// A coefficient below this is negative, and not zero with a rounding error.
const LEAST: f64 = -1e-9;

/// Number and distance of the impulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EvenSpacing {
    /// Number of impulses, 3 to [`MAX_IMPULSES`].
    pub impulses: u8,
    /// Damped periods from the first impulse to the last, 1/1000; less than half of the
    /// impulses but one.
    pub period_thousandths: u16,
}

impl EvenSpacing {
    /// Allowed numbers, in words.
    pub const RULE: &'static str =
        "N from 3 to 5, and T below (N-1)/2 but not so small that an impulse would be negative";

    /// Parses the parentheses of a name such as `mzv(5,0.9)` or, in Klipper's form,
    /// `mzv(n=5,t=0.9)`.
    #[cold]
    #[inline(never)]
    pub(super) fn from_text(text: &str) -> Option<Self> {
        let (impulses, periods) = text.split_once(',')?;
        let impulses = thousandths(impulses.strip_prefix("n=").unwrap_or(impulses))?;
        let period_thousandths = thousandths(periods.strip_prefix("t=").unwrap_or(periods))?;
        (impulses % 1000 == 0).then_some(Self { impulses: (impulses / 1000) as u8, period_thousandths })
    }

    /// Part of a damped period between two impulses.
    pub(super) fn distance_periods(self) -> f64 {
        f64::from(self.period_thousandths) / 1000.0 / f64::from(self.impulses.saturating_sub(1).max(1))
    }

    /// Weights without damping; `None` if the numbers are out of range or a weight
    /// would be negative.
    #[cold]
    #[inline(never)]
    pub(super) fn weights(self) -> Option<Weights> {
        let zeros = self.impulses.checked_sub(1)?;
        let thousandths = self.period_thousandths;
        if zeros < 2 || usize::from(zeros) >= MAX_IMPULSES || thousandths == 0 || thousandths >= u16::from(zeros) * 500
        {
            return None;
        }
        let first = core::f64::consts::TAU * self.distance_periods();
        let apart = (core::f64::consts::TAU - 2.0 * first) / f64::from(zeros - 1);
        let mut weights = Weights { values: [0.0; MAX_IMPULSES], count: 1 };
        weights.values[0] = 1.0;
        for pair in 0..zeros / 2 {
            let middle = -2.0 * cosine(first + f64::from(pair) * apart);
            weights.multiply([1.0, middle, 1.0]);
        }
        if zeros % 2 == 1 {
            weights.multiply([1.0, 1.0, 0.0]);
        }
        weights.count = usize::from(self.impulses);
        weights.as_slice().iter().all(|weight| *weight >= LEAST).then_some(weights)
    }
}

/// Coefficients of a polynomial.
pub(super) struct Weights {
    values: [f64; MAX_IMPULSES],
    count: usize,
}

impl Weights {
    /// The coefficients.
    pub fn as_slice(&self) -> &[f64] {
        self.values.get(..self.count).unwrap_or_default()
    }

    /// Multiplies by another polynomial; coefficients without a place are 0.
    fn multiply(&mut self, [constant, linear, square]: [f64; 3]) {
        let (mut before, mut before_that) = (0.0, 0.0);
        for value in &mut self.values {
            let product = *value * constant + before * linear + before_that * square;
            (before_that, before) = (before, *value);
            *value = product;
        }
    }
}

/// Cosine of an angle from 0 to pi, by its series: libm's takes any angle, and ten times the flash.
fn cosine(angle: f64) -> f64 {
    let (mut sum, mut term) = (1.0, 1.0);
    // The last term is below 1e-18.
    for double in 1..=15 {
        let even = 2.0 * f64::from(double);
        term *= -angle * angle / (even * (even - 1.0));
        sum += term;
    }
    sum
}

/// A decimal number with at most three digits after the point.
#[cold]
#[inline(never)]
fn thousandths(text: &str) -> Option<u16> {
    let (mut value, mut missing, mut after_point) = (0_u16, 3, false);
    for byte in text.bytes() {
        if byte == b'.' && !after_point {
            after_point = true;
            continue;
        }
        if !byte.is_ascii_digit() || missing == 0 {
            return None;
        }
        missing -= i32::from(after_point);
        value = value.checked_mul(10)?.checked_add(u16::from(byte - b'0'))?;
    }
    for _ in 0..missing {
        value = value.checked_mul(10)?;
    }
    // A number has at least one digit.
    (text.len() > usize::from(after_point)).then_some(value)
}
