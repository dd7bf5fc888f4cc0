//! A time that a printer took, and the limits that would explain it.

use std::fmt;
use std::str::FromStr;

use serde::Serialize;

use crate::duration::hms;

/// Difference from the measured time below which the estimate needs no explanation,
/// as a part of it.
const SAME: f64 = 0.005;

/// A limit with which the print would take the measured time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explanation {
    /// Name of the limit.
    pub limit: &'static str,
    /// Factor of the limit, in the profile and in the file.
    pub factor: f64,
}

/// A measured time beside an estimate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Took {
    /// The measured time, s.
    pub measured_s: f64,
    /// The measured time less the estimated one, s.
    pub difference_s: f64,
    /// Limits that would explain it one by one, the nearest to the profile's first.
    pub explained_by: Vec<Explanation>,
}

impl Took {
    /// Returns true if estimate and measurement agree.
    pub fn agrees(measured_s: f64, estimated_s: f64) -> bool {
        (measured_s - estimated_s).abs() <= SAME * measured_s
    }
}

impl fmt::Display for Took {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { measured_s, difference_s, explained_by } = self;
        let (size, more) = (hms(difference_s.abs()), if *difference_s < 0.0 { "less" } else { "more" });
        writeln!(out, "  took         {}: {size} {more} than estimated", hms(*measured_s))?;
        if Self::agrees(*measured_s, measured_s - difference_s) {
            return writeln!(out, "  explained    no limit needs to differ");
        }
        for (index, Explanation { limit, factor }) in explained_by.iter().enumerate() {
            let name = if index == 0 { "explained" } else { "or" };
            writeln!(out, "  {name:12} {limit}: {factor:.3} times")?;
        }
        if explained_by.is_empty() {
            writeln!(
                out,
                "  explained    by no limit alone, 16 times as large or as small: heating and waits may differ"
            )?;
        }
        Ok(())
    }
}

/// A duration as a person writes it: 5h01, 5h01m30s, 5:01:30, 301m, 90s; s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Duration(pub f64);

impl FromStr for Duration {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || format!("\"{text}\" is not a duration above 0: expected 5h01, 5h01m30s, 5:01:30, 301m or 90s");
        let text = text.trim().to_ascii_lowercase();
        let mut seconds = 0.0;
        if text.contains(':') {
            let parts: Vec<&str> = text.split(':').collect();
            if !(2..=3).contains(&parts.len()) {
                return Err(refused());
            }
            for part in parts {
                seconds = seconds * 60.0 + number(part).ok_or_else(refused)?;
            }
        } else {
            // A number without a unit is of the one after the last.
            let mut unit_s = None;
            let mut rest = text.as_str();
            while !rest.is_empty() {
                let end = rest.find(|letter: char| !letter.is_ascii_digit() && letter != '.').unwrap_or(rest.len());
                let value = number(rest.get(..end).unwrap_or_default()).ok_or_else(refused)?;
                rest = rest.get(end..).unwrap_or_default();
                let letters = rest.find(|letter: char| letter.is_ascii_digit()).unwrap_or(rest.len());
                let factor_s = match (rest.get(..letters).unwrap_or_default().trim(), unit_s) {
                    ("h", None) => 3600.0,
                    ("m" | "min", None | Some(3600.0)) => 60.0,
                    ("s", None | Some(3600.0 | 60.0)) => 1.0,
                    ("", Some(3600.0)) => 60.0,
                    ("", Some(60.0)) => 1.0,
                    _ => return Err(refused()),
                };
                rest = rest.get(letters..).unwrap_or_default();
                seconds += value * factor_s;
                unit_s = Some(factor_s);
            }
        }
        if seconds > 0.0 && seconds.is_finite() { Ok(Self(seconds)) } else { Err(refused()) }
    }
}

/// A number of digits, with or without a fraction.
fn number(text: &str) -> Option<f64> {
    let is_number = text.starts_with(|first: char| first.is_ascii_digit()) && text.len() < 24;
    text.parse().ok().filter(|_| is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_read_as_people_write_them() {
        for (text, expected) in [
            ("5h01", 18_060.0),
            ("5h01m30s", 18_090.0),
            ("5h 1min", 18_060.0),
            ("5:01:30", 18_090.0),
            ("301m", 18_060.0),
            ("1.5h", 5400.0),
            ("90s", 90.0),
            ("12m30", 750.0),
        ] {
            assert_eq!(text.parse(), Ok(Duration(expected)), "{text}");
        }
        for text in ["", "5", "0s", "h", "5h5h", "5m1h", "-5m", "5:", "1:2:3:4", "nanm", "1e9s", "5d"] {
            assert!(text.parse::<Duration>().is_err(), "{text}");
        }
    }
}
