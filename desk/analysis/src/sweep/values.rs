//! The values of a sweep, as a person writes them.

use std::fmt;
use std::str::FromStr;

/// The most values of a sweep.
pub const MAX_VALUES: usize = 32;

/// Numbers in the order in which they were given: `500,1000,3000`, or `500..16000` for each twice
/// the one before, from the first to the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Values(Vec<f64>);

/// Reason for which a text does not describe [`Values`].
#[derive(Clone, Debug, PartialEq)]
pub enum ValuesError {
    /// The text is not a finite number.
    Number(String),
    /// The range does not rise from a number above 0.
    Range,
    /// The values are more than 32.
    TooMany(usize),
}

impl Values {
    /// The numbers.
    pub fn iter(&self) -> impl Iterator<Item = f64> {
        self.0.iter().copied()
    }
}

impl FromStr for Values {
    type Err = ValuesError;

    fn from_str(text: &str) -> Result<Self, ValuesError> {
        let number = |text: &str| {
            let parsed = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
            parsed.ok_or_else(|| ValuesError::Number(text.trim().to_owned()))
        };
        let values = match text.split_once("..") {
            Some((first, last)) => {
                let (first, last) = (number(first)?, number(last)?);
                if !(first > 0.0 && last > first) {
                    return Err(ValuesError::Range);
                }
                let doubled = std::iter::successors(Some(first), |value| Some(2.0 * value));
                doubled.take_while(|value| *value < last).take(MAX_VALUES).chain([last]).collect()
            }
            None => text.split(',').map(number).collect::<Result<Vec<_>, _>>()?,
        };
        if values.len() > MAX_VALUES { Err(ValuesError::TooMany(values.len())) } else { Ok(Self(values)) }
    }
}

impl fmt::Display for ValuesError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(text) => {
                write!(out, "\"{text}\" is not a number, expected a range as 500..16000 or a list as 500,1000,3000")
            }
            Self::Range => out.write_str("a range begins above 0 and rises, as 500..16000"),
            Self::TooMany(count) => write!(out, "{count} values are too many, expected at most {MAX_VALUES}"),
        }
    }
}

impl std::error::Error for ValuesError {}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_range_doubles_up_to_its_end() {
        let values = |text: &str| text.parse::<Values>().unwrap().0;
        assert_eq!(values("500..16000"), [500.0, 1000.0, 2000.0, 4000.0, 8000.0, 16000.0]);
        assert_eq!(values("0.01 .. 0.03"), [0.01, 0.02, 0.03]);
        assert_eq!(values("3,1, 2.5"), [3.0, 1.0, 2.5]);
        assert_eq!(values("7"), [7.0]);
    }

    #[test]
    fn what_is_no_range_is_refused() {
        let error = |text: &str| text.parse::<Values>().unwrap_err();
        assert_eq!(error("1,x"), ValuesError::Number("x".to_owned()));
        assert_eq!(error(""), ValuesError::Number(String::new()));
        assert_eq!(error("nan"), ValuesError::Number("nan".to_owned()));
        for range in ["0..5", "5..5", "5..1", "-1..2"] {
            assert_eq!(error(range), ValuesError::Range, "{range}");
        }
        assert_eq!(error("1e-9..1e9"), ValuesError::TooMany(MAX_VALUES + 1));
        assert_eq!(error(&["1"; 40].join(",")), ValuesError::TooMany(40));
    }
}
