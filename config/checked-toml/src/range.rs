//! Ranges of numbers: their check and their text.

use std::fmt;

/// A closed range of finite numbers and their unit; NaN lies outside every range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
    /// The unit in words; empty for a plain number.
    pub unit: &'static str,
    /// Ends that no other key narrows.
    declared: [f64; 2],
    /// Name of the limit that narrowed them; empty without one.
    narrowed_by: &'static str,
}

/// A range from `low` to `high`.
pub const fn range(low: f64, high: f64, unit: &'static str) -> Range {
    Range { low, high, unit, declared: [low, high], narrowed_by: "" }
}

impl Range {
    /// The range with its upper end at `high` or below; `why` continues the sentence that a refusal
    /// shows: "0.01 to 50 mm/s, at most fast_mm_per_s".
    #[must_use]
    pub fn at_most(self, high: f64, why: &'static str) -> Self {
        Self { high: self.high.min(high), narrowed_by: why, ..self }
    }

    /// The range with its lower end at `low` or above; `why` as for [`Self::at_most`].
    #[must_use]
    pub fn at_least(self, low: f64, why: &'static str) -> Self {
        Self { low: self.low.max(low), narrowed_by: why, ..self }
    }

    /// The range between two values; `why` as for [`Self::at_most`].
    #[must_use]
    pub fn between(self, low: f64, high: f64, why: &'static str) -> Self {
        self.at_least(low, why).at_most(high, why)
    }

    /// Returns true if a value lies within.
    pub fn contains(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// The range for a book's table, where no other key has a value: "0.01 to 2 000, at
    /// most fast_mm_per_s".
    pub(crate) fn for_book(&self) -> String {
        let [low, high] = self.declared.map(book_number);
        match self.narrowed_by {
            "" => format!("{low} to {high}"),
            why => format!("{low} to {high}, {why}"),
        }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to {}", self.low, self.high)?;
        if !self.unit.is_empty() {
            write!(f, " {}", self.unit)?;
        }
        if !self.narrowed_by.is_empty() {
            write!(f, ", {}", self.narrowed_by)?;
        }
        Ok(())
    }
}

/// A number as a book prints it: a true minus sign, and groups of three digits from 10,000 on.
pub(crate) fn book_number(number: f64) -> String {
    let text = number.abs().to_string();
    let (whole, fraction) = text.split_once('.').map_or((text.as_str(), ""), |(whole, fraction)| (whole, fraction));
    let mut shown = String::from(if number < 0.0 { "−" } else { "" });
    for (index, digit) in whole.chars().enumerate() {
        let following = whole.len() - index;
        if index > 0 && following.is_multiple_of(3) && whole.len() > 4 {
            shown.push(' ');
        }
        shown.push(digit);
    }
    if !fraction.is_empty() {
        shown.push('.');
        shown.push_str(fraction);
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_book_groups_digits() {
        for (number, shown) in [(0.0001, "0.0001"), (-300.0, "−300"), (2000.0, "2000"), (10_000_000.0, "10 000 000")]
        {
            assert_eq!(book_number(number), shown);
        }
    }

    #[test]
    fn a_narrowed_range_says_by_what() {
        let feed = range(0.01, 2_000.0, "mm/s").at_most(50.0, "at most fast_mm_per_s");
        assert_eq!(feed.to_string(), "0.01 to 50 mm/s, at most fast_mm_per_s");
        assert_eq!(feed.for_book(), "0.01 to 2000, at most fast_mm_per_s");
        assert!(feed.contains(50.0) && !feed.contains(50.1) && !feed.contains(f64::NAN));
    }
}
