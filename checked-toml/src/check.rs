//! Ranges of single values, and the errors that name the key, the value and the line.

use std::fmt;

use toml::Spanned;

use crate::error::{FileError, Problem};
use crate::locate::line_of;

/// A closed range of finite numbers and their unit.
#[derive(Clone, Copy, Debug)]
pub struct Range {
    /// Smallest.
    pub low: f64,
    /// Largest.
    pub high: f64,
    /// Unit, in words; may be empty.
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
#[derive(Clone, Copy, Debug)]
pub struct Checker<'a> {
    text: &'a str,
    origin: &'a str,
}

impl<'a> Checker<'a> {
    /// Checks values of `text`; `origin` (a path or a name) stands in front of the line number in errors.
    pub fn new(text: &'a str, origin: &'a str) -> Checker<'a> {
        Checker { text, origin }
    }

    /// The value, if it is within its range. NaN is within none.
    ///
    /// # Errors
    /// It is not; the error names the key, the line and the range.
    pub fn number(&self, key: &str, value: &Spanned<f64>, range: Range) -> Result<f64, FileError> {
        let number = *value.get_ref();
        if (range.low..=range.high).contains(&number) { Ok(number) } else { Err(self.refuse(key, value, range)) }
    }

    /// The error for a value that is not what was expected.
    pub fn refuse(&self, key: &str, value: &Spanned<impl fmt::Display>, expected: impl fmt::Display) -> FileError {
        let problem = Problem::OutOfRange {
            key: key.to_owned(),
            value: value.get_ref().to_string(),
            expected: expected.to_string(),
        };
        FileError::new(self.origin, Some(line_of(self.text, value.span().start)), problem)
    }

    /// Line of a value, counted from 1.
    pub fn line_of<T>(&self, value: &Spanned<T>) -> usize {
        line_of(self.text, value.span().start)
    }
}
