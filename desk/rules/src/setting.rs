//! Checks of settings.

use std::fmt;

/// Setting with which no plan can be made.
#[derive(Clone, Debug, PartialEq)]
pub struct SettingError {
    name: String,
    value: f64,
    expected: &'static str,
}

impl SettingError {
    /// Returns the setting's name, as its firmware writes it.
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl fmt::Display for SettingError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{} is {}, expected {}", self.name, self.value, self.expected)
    }
}

impl std::error::Error for SettingError {}

/// Refuses a value that is not above 0. Infinity means no limit.
pub(crate) fn positive(name: &str, value: f64) -> Result<(), SettingError> {
    if value > 0.0 { Ok(()) } else { Err(refused(name, value, "more than 0")) }
}

/// Refuses a negative value.
pub(crate) fn not_negative(name: &str, value: f64) -> Result<(), SettingError> {
    if value >= 0.0 { Ok(()) } else { Err(refused(name, value, "0 or more")) }
}

/// Refuses values of axes that are not above 0.
pub(crate) fn positive_axes(name: &str, values: [f64; 4]) -> Result<(), SettingError> {
    for (axis, value) in crate::motion::Axis::ALL.into_iter().zip(values) {
        positive(&format!("{name} {}", axis.letter()), value)?;
    }
    Ok(())
}

/// Creates the error that refuses a value.
pub(crate) fn refused(name: &str, value: f64, expected: &'static str) -> SettingError {
    SettingError { name: name.to_owned(), value, expected }
}
