//! What was odd about a line that is carried out all the same.

use core::fmt;

/// One of [`Remarks`]. Letters are upper case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remark {
    /// A word without a number was ignored.
    NoNumber(u8),
    /// A number of zero or less, where something must move, was ignored.
    NotAboveZero(u8),
    /// The fraction of a number that must be whole was dropped.
    Fraction(u8),
    /// A number above its range became the largest one.
    TooLarge(u8),
    /// A second command in the line, and all behind it, was ignored.
    SecondCommand,
    /// G4 without P and S.
    BareDwell,
    /// M106 with P and without S: other firmware takes P for the power.
    FanPower,
}

/// How a line was read that another machine might read otherwise: what of it was ignored or changed.
///
/// `Display` tells all of it in one line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Remarks {
    /// A bit for each letter, `A` the lowest.
    no_number: u32,
    not_above_zero: u32,
    fraction: u32,
    too_large: u32,
    /// A bit for each remark that concerns no word.
    about_line: u32,
}

/// Bits of `about_line`, and what they say.
const ABOUT_LINE: [&str; 3] = [
    "expected one command a line, the second and all behind it are ignored",
    "without P or S it waits until all motion has ended",
    "P is the fan's number and this fan does not exist, expected the power after S",
];

impl Remarks {
    /// Nothing was odd.
    pub const NONE: Self = Remarks { no_number: 0, not_above_zero: 0, fraction: 0, too_large: 0, about_line: 0 };

    /// Whether nothing was odd.
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

    /// Adds all of `other`; returns those of it that were not there before.
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
            (self.fraction, "is whole, its fraction is dropped"),
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
    fn each_is_told_once() {
        let mut said = Remarks::default();
        let mut line = Remarks::default();
        line.add(Remark::NoNumber(b'E'));
        line.add(Remark::SecondCommand);
        assert_eq!(said.merge(&line), line);
        assert!(said.merge(&line).is_empty());
        line.add(Remark::NoNumber(b'Z'));
        line.add(Remark::Fraction(b'E'));
        assert_eq!(said.merge(&line).to_string(), "Z without a number is ignored; E is whole, its fraction is dropped");
    }

    #[test]
    fn all_of_them_have_words() {
        for (remark, text) in [
            (Remark::NotAboveZero(b'T'), "T is not above 0 and is ignored"),
            (Remark::TooLarge(b'S'), "S is too large and becomes the largest value"),
            (Remark::SecondCommand, "expected one command a line, the second and all behind it are ignored"),
            (Remark::BareDwell, "without P or S it waits until all motion has ended"),
            (Remark::FanPower, "P is the fan's number and this fan does not exist, expected the power after S"),
        ] {
            let mut remarks = Remarks::default();
            remarks.add(remark);
            assert_eq!(remarks.to_string(), text);
        }
    }
}
