//! Pins by the names that data sheets give them.

use std::fmt;

/// A pin of a chip. As text, `PE9`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pin {
    /// Index of its port: 0 for A.
    pub port: u8,
    /// Number within the port, 0 to 15.
    pub number: u8,
}

impl Pin {
    /// The pin of a name such as `PE9`.
    pub fn named(name: &str) -> Option<Self> {
        let mut letters = name.strip_prefix('P')?.chars();
        let port = letters.next().filter(char::is_ascii_uppercase)?;
        let digits = letters.as_str();
        // One spelling a pin: `PE09` and `PE+9` are refused.
        let number = digits.parse().ok().filter(|number: &u8| *number < 16 && number.to_string() == digits)?;
        Some(Self { port: port as u8 - b'A', number })
    }

    /// The pin's bit in a word of its port.
    pub const fn bit(self) -> u32 {
        1 << self.number
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "P{}{}", char::from(b'A' + self.port), self.number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pin_has_one_name() {
        for (port, number) in (0..9).flat_map(|port| (0..16).map(move |number| (port, number))) {
            let pin = Pin { port, number };
            assert_eq!(Pin::named(&pin.to_string()), Some(pin));
        }
        for no_pin in ["", "P", "PA", "A0", "PA16", "PA00", "PA+1", "pa1", "Pa1", "P11", "PA1 ", "PA-1", "P\u{e4}1"] {
            assert_eq!(Pin::named(no_pin), None, "{no_pin}");
        }
    }
}
