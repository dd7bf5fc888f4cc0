//! Remarks about odd lines, which are executed all the same.

use core::fmt;

/// One remark. Letters are upper case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remark {
    /// A word without a number was ignored.
    NoNumber(u8),
    /// A number of zero or less was ignored where it must be above zero.
    NotAboveZero(u8),
    /// The fraction of a number that must be whole was dropped.
    Fraction(u8),
    /// A number above its range became the maximum.
    TooLarge(u8),
    /// A second command in the line, and everything after it, was ignored.
    SecondCommand,
    /// G4 without P and S.
    BareDwell,
    /// M106 with P and without S; other firmware takes P for the power.
    FanPower,
}

/// What of a line was ignored or changed, so that the host learns how the line was read.
///
/// `Display` writes all remarks in one line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Remarks {
    /// A bit for each letter, `A` the lowest.
    no_number: u32,
    not_above_zero: u32,
    fraction: u32,
    too_large: u32,
    /// A bit for each remark about the line as a whole.
    about_line: u32,
}

/// Texts of the bits of `about_line`.
const ABOUT_LINE: [&str; 3] = [
    "one command a line: the second and everything after it is ignored",
    "without P or S: waits until all motion has ended",
    "P is the number of a fan, and this machine has no such fan; give the power with S",
];

impl Remarks {
    /// No remarks.
    pub const NONE: Self = Remarks { no_number: 0, not_above_zero: 0, fraction: 0, too_large: 0, about_line: 0 };

    /// Whether there are no remarks.
    pub fn is_empty(&self) -> bool {
        *self == Self::NONE
    }

    /// Adds a remark.
    pub fn add(&mut self, remark: Remark) {
        let letter = |letter: u8| 1 << (letter.wrapping_sub(b'A') & 31);
        match remark {
            Remark::NoNumber(word) => self.no_number |= letter(word),
            Remark::NotAboveZero(word) => self.not_above_zero |= letter(word),
            Remark::Fraction(word) => self.fraction |= letter(word),
            Remark::TooLarge(word) => self.too_large |= letter(word),
            Remark::SecondCommand => self.about_line |= 1,
            Remark::BareDwell => self.about_line |= 2,
            Remark::FanPower => self.about_line |= 4,
        }
    }

    /// Adds all of `other`; returns the remarks that are new.
    pub fn merge(&mut self, other: &Self) -> Self {
        let merge = |all: &mut u32, more: u32| {
            let new = more & !*all;
            *all |= more;
            new
        };
        Self {
            no_number: merge(&mut self.no_number, other.no_number),
            not_above_zero: merge(&mut self.not_above_zero, other.not_above_zero),
            fraction: merge(&mut self.fraction, other.fraction),
            too_large: merge(&mut self.too_large, other.too_large),
            about_line: merge(&mut self.about_line, other.about_line),
        }
    }
}

impl fmt::Display for Remarks {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        let words = [
            (self.no_number, "without a number is ignored"),
            (self.not_above_zero, "is not above 0 and is ignored"),
            (self.fraction, "must be whole, the fraction is dropped"),
            (self.too_large, "is too large and becomes the largest value"),
        ];
        for (letters, says) in words {
            for letter in (b'A'..=b'Z').filter(|letter| letters >> (letter - b'A') & 1 == 1) {
                write!(out, "{separator}{} {says}", char::from(letter))?;
                separator = "; ";
            }
        }
        for says in ABOUT_LINE.iter().zip(0..).filter(|(_, bit)| self.about_line >> bit & 1 == 1).map(|(says, _)| says)
        {
            write!(out, "{separator}{says}")?;
            separator = "; ";
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_remark_is_reported_once() {
        let mut said = Remarks::default();
        let mut line = Remarks::default();
        line.add(Remark::NoNumber(b'E'));
        line.add(Remark::SecondCommand);
        assert_eq!(said.merge(&line), line);
        assert!(said.merge(&line).is_empty());
        line.add(Remark::NoNumber(b'Z'));
        line.add(Remark::Fraction(b'E'));
        assert_eq!(
            said.merge(&line).to_string(),
            "Z without a number is ignored; E must be whole, the fraction is dropped"
        );
    }

    #[test]
    fn every_remark_has_a_text() {
        for (remark, text) in [
            (Remark::NotAboveZero(b'T'), "T is not above 0 and is ignored"),
            (Remark::TooLarge(b'S'), "S is too large and becomes the largest value"),
            (Remark::SecondCommand, "one command a line: the second and everything after it is ignored"),
            (Remark::BareDwell, "without P or S: waits until all motion has ended"),
            (Remark::FanPower, "P is the number of a fan, and this machine has no such fan; give the power with S"),
        ] {
            let mut remarks = Remarks::default();
            remarks.add(remark);
            assert_eq!(remarks.to_string(), text);
        }
    }
}
