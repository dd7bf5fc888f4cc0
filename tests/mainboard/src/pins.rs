//! Pins by their names on a circuit diagram.

use std::fmt;
use std::str::FromStr;

/// A pin of the chip, such as PD1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub struct Pin {
    /// The pin's port, 0 for A.
    pub port: u8,
    /// The pin's number, 0 to 15.
    pub number: u8,
}

impl FromStr for Pin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused =
            || format!("{text:?} is not a pin: write a name such as \"PD1\", with port A to K and number 0 to 15");
        let mut letters = text.chars();
        let (Some('P'), Some(port @ 'A'..='K')) = (letters.next(), letters.next()) else {
            return Err(refused());
        };
        let number: u8 = letters.as_str().parse().map_err(|_| refused())?;
        if number > 15 {
            return Err(refused());
        }
        Ok(Self { port: port as u8 - b'A', number })
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "P{}{}", char::from(b'A' + self.port), self.number)
    }
}
