//! The words after a command: `X87.153 Y86.702 E.03647`.

use super::char_at;
use crate::{AxisFlags, AxisWords, Decimal, NumberError, ParseError, ShortText};

/// The words of a line, by letter.
pub(super) struct Words {
    /// Bit 0 = A: the letter is there.
    present: u32,
    /// The letter has a number.
    valued: u32,
    values: [Decimal; 26],
}

/// The bit of an upper-case letter.
const fn bit(letter: u8) -> u32 {
    1 << (letter - b'A')
}

impl Words {
    /// No words.
    pub(super) const NONE: Self = Words { present: 0, valued: 0, values: [Decimal::ZERO; 26] };

    pub(super) fn parse(text: &str) -> Result<Self, ParseError> {
        let mut words = Words::NONE;
        words.read(text)?;
        Ok(words)
    }

    /// Reads the words of a line into an empty list: for the commonest commands, as a list is long to copy.
    pub(super) fn read(&mut self, text: &str) -> Result<(), ParseError> {
        let words = self;
        let bytes = text.as_bytes();
        let mut at = 0;
        loop {
            at = skip_blanks(bytes, at);
            let upper = match bytes.get(at) {
                None | Some(b'*' | b';') => break,
                Some(byte) => byte.to_ascii_uppercase(),
            };
            if !upper.is_ascii_uppercase() {
                return Err(ParseError::UnexpectedCharacter(char_at(text, at)));
            }
            at = skip_blanks(bytes, at + 1);
            let (bit, index) = (bit(upper), usize::from(upper - b'A'));
            words.present |= bit;
            if !matches!(bytes.get(at), Some(b'0'..=b'9' | b'.' | b'-' | b'+')) {
                words.valued &= !bit;
                continue;
            }
            let (length, number) = Decimal::parse_prefix(bytes.get(at..).unwrap_or_default());
            words.valued |= bit;
            words.values[index] = match number {
                Ok(value) => value,
                Err(error) => {
                    let letter = char::from(upper);
                    let text = ShortText::new(text.get(at..at + length).unwrap_or_default());
                    return Err(match error {
                        NumberError::NotANumber => ParseError::NotANumber { letter, text },
                        NumberError::TooLarge => ParseError::TooLarge { letter, text },
                    });
                }
            };
            at += length;
        }
        for letter in [b'G', b'M'] {
            if words.has(letter) {
                return Err(ParseError::SecondCommand { letter: char::from(letter) });
            }
        }
        Ok(())
    }

    /// Whether the letter is there, with or without a number.
    pub(super) const fn has(&self, letter: u8) -> bool {
        self.present & bit(letter) != 0
    }

    /// The number of a word; a letter without one is an error.
    pub(super) fn value(&self, letter: u8) -> Result<Option<Decimal>, ParseError> {
        if !self.has(letter) {
            Ok(None)
        } else if self.valued & bit(letter) != 0 {
            Ok(Some(self.values[usize::from(letter - b'A')]))
        } else {
            Err(ParseError::NumberExpected { letter: char::from(letter) })
        }
    }

    /// A number above zero.
    pub(super) fn above_zero(&self, letter: u8) -> Result<Option<Decimal>, ParseError> {
        match self.value(letter)? {
            Some(value) if value <= Decimal::ZERO => {
                Err(ParseError::NotAboveZero { letter: char::from(letter), value })
            }
            value => Ok(value),
        }
    }

    /// A number that is not negative.
    pub(super) fn not_negative(&self, letter: u8) -> Result<Option<Decimal>, ParseError> {
        match self.value(letter)? {
            Some(value) if value.is_negative() => Err(ParseError::BelowZero { letter: char::from(letter), value }),
            value => Ok(value),
        }
    }

    /// A whole number.
    pub(super) fn whole(&self, letter: u8) -> Result<Option<i64>, ParseError> {
        let Some(value) = self.value(letter)? else { return Ok(None) };
        match value.to_i64_exact() {
            Some(whole) => Ok(Some(whole)),
            None => Err(ParseError::NotWhole { letter: char::from(letter), value }),
        }
    }

    /// A whole number from 0 to `high`.
    pub(super) fn whole_to(&self, letter: u8, high: u8) -> Result<Option<u8>, ParseError> {
        let Some(whole) = self.whole(letter)? else { return Ok(None) };
        match u8::try_from(whole) {
            Ok(whole) if whole <= high => Ok(Some(whole)),
            _ => Err(self.out_of_range(letter, 0, u16::from(high))),
        }
    }

    /// A whole number from 0 to `high`, which may be above 255.
    pub(super) fn whole_up_to(&self, letter: u8, high: u16) -> Result<Option<u16>, ParseError> {
        let Some(whole) = self.whole(letter)? else { return Ok(None) };
        match u16::try_from(whole) {
            Ok(whole) if whole <= high => Ok(Some(whole)),
            _ => Err(self.out_of_range(letter, 0, high)),
        }
    }

    /// A number from 0 to 255, rounded to the nearest whole one.
    pub(super) fn nearest_byte(&self, letter: u8) -> Result<Option<u8>, ParseError> {
        let Some(value) = self.value(letter)? else { return Ok(None) };
        // -0.3 would round to 0 and is refused all the same.
        match u8::try_from(value.round_scaled(1)) {
            Ok(byte) if !value.is_negative() => Ok(Some(byte)),
            _ => Err(self.out_of_range(letter, 0, 255)),
        }
    }

    /// 0 or 1.
    pub(super) fn switch(&self, letter: u8) -> Result<Option<bool>, ParseError> {
        Ok(self.whole_to(letter, 1)?.map(|value| value == 1))
    }

    /// A number above zero and at most `high`.
    pub(super) fn above_zero_to(&self, letter: u8, high: u16) -> Result<Option<Decimal>, ParseError> {
        match self.above_zero(letter)? {
            Some(value) if value > Decimal::from_nanos(i64::from(high) * 1_000_000_000) => {
                Err(self.out_of_range(letter, 0, high))
            }
            value => Ok(value),
        }
    }

    /// A number that is not negative, times `factor` (1 or 1000), rounded to the nearest whole one.
    pub(super) fn nearest(&self, letter: u8, factor: i64) -> Result<Option<u64>, ParseError> {
        Ok(self.not_negative(letter)?.map(|value| value.round_scaled(factor).unsigned_abs()))
    }

    /// X, Y, Z and E.
    pub(super) fn axes(&self) -> Result<AxisWords, ParseError> {
        Ok(AxisWords { x: self.value(b'X')?, y: self.value(b'Y')?, z: self.value(b'Z')?, e: self.value(b'E')? })
    }

    /// X, Y, Z and E, all above zero.
    pub(super) fn axis_limits(&self) -> Result<AxisWords, ParseError> {
        Ok(AxisWords {
            x: self.above_zero(b'X')?,
            y: self.above_zero(b'Y')?,
            z: self.above_zero(b'Z')?,
            e: self.above_zero(b'E')?,
        })
    }

    /// Which of X, Y, Z and E are named.
    pub(super) const fn axis_flags(&self) -> AxisFlags {
        AxisFlags { x: self.has(b'X'), y: self.has(b'Y'), z: self.has(b'Z'), e: self.has(b'E') }
    }

    /// Whether a word names a second tool, which this machine does not have.
    pub(super) fn names_other_tool(&self) -> Result<bool, ParseError> {
        Ok(self.value(b'T')?.is_some_and(|tool| tool != Decimal::ZERO))
    }

    fn out_of_range(&self, letter: u8, low: u16, high: u16) -> ParseError {
        let value = self.values[usize::from(letter - b'A')];
        ParseError::OutOfRange { letter: char::from(letter), value, low, high }
    }
}

/// The first place from `at` on that is no space, tab or `( )` comment; an open comment goes to the end.
#[inline]
pub(super) fn skip_blanks(bytes: &[u8], mut at: usize) -> usize {
    while let Some(&byte) = bytes.get(at) {
        match byte {
            b' ' | b'\t' => at += 1,
            b'(' => {
                let rest = bytes.get(at..).unwrap_or_default();
                at += rest.iter().position(|&byte| byte == b')').map_or(rest.len(), |end| end + 1);
            }
            _ => break,
        }
    }
    at
}
