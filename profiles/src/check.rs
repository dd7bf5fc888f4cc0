//! Ranges of single values, and the errors that name the key, the value and the line.

use std::fmt;

use toml::Spanned;

use crate::error::{Problem, ProfileError};
use crate::file::{Number, Xyz, Xyze};
use crate::locate::line_of;

/// A closed range of finite numbers and their unit.
#[derive(Clone, Copy)]
pub struct Range {
    pub low: f64,
    pub high: f64,
    pub unit: &'static str,
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let space = if self.unit.is_empty() { "" } else { " " };
        write!(f, "{} to {}{space}{}", self.low, self.high, self.unit)
    }
}

/// Shorthand for a [`Range`].
pub const fn range(low: f64, high: f64, unit: &'static str) -> Range {
    Range { low, high, unit }
}

/// The text that is being checked and where it came from.
pub struct Checker<'a> {
    text: &'a str,
    origin: &'a str,
}

impl<'a> Checker<'a> {
    pub fn new(text: &'a str, origin: &'a str) -> Checker<'a> {
        Checker { text, origin }
    }

    /// The value, if it is within its range. NaN is within none.
    pub fn number(&self, key: &str, value: &Number, range: Range) -> Result<f64, ProfileError> {
        let number = *value.get_ref();
        if (range.low..=range.high).contains(&number) { Ok(number) } else { Err(self.refuse(key, value, range)) }
    }

    /// The values of X, Y and Z.
    pub fn three(&self, key: &str, values: &Xyz, range: Range) -> Result<[f64; 3], ProfileError> {
        Ok([
            self.number(&format!("{key}.x"), &values.x, range)?,
            self.number(&format!("{key}.y"), &values.y, range)?,
            self.number(&format!("{key}.z"), &values.z, range)?,
        ])
    }

    /// The values of X, Y, Z and the extruder.
    pub fn four(&self, key: &str, values: &Xyze, range: Range) -> Result<[f64; 4], ProfileError> {
        Ok([
            self.number(&format!("{key}.x"), &values.x, range)?,
            self.number(&format!("{key}.y"), &values.y, range)?,
            self.number(&format!("{key}.z"), &values.z, range)?,
            self.number(&format!("{key}.e"), &values.e, range)?,
        ])
    }

    /// The error for a value that is not what was expected.
    pub fn refuse(&self, key: &str, value: &Spanned<impl fmt::Display>, expected: impl fmt::Display) -> ProfileError {
        let problem = Problem::OutOfRange {
            key: key.to_owned(),
            value: value.get_ref().to_string(),
            expected: expected.to_string(),
        };
        ProfileError::new(self.origin, Some(line_of(self.text, value.span().start)), problem)
    }
}
