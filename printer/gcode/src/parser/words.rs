//! The words after a command: `X87.153 Y86.702 E.03647`.

use crate::remarks::{Remark, Remarks};
use crate::{AxisFlags, AxisWords, Decimal, NumberError, ParseError, ShortText};

/// Treatment of a number without its letter.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Strays {
    /// The number is ignored, with a remark.
    Remarked,
    /// The number is an error: it could have been a coordinate.
    Refused,
    /// Ignored with a remark, like [`Self::Remarked`]; in addition `=` may come before a
    /// number, as in Klipper.
    Assigned,
}

/// The words of a line, by letter. Oddities of the words that are asked for go to `remarks`; so do,
/// in the end, the words that were never asked for.
pub(super) struct Words<'a> {
    remarks: &'a mut Remarks,
    /// Bit 0 = A: the letter is there.
    present: u32,
    /// The letter was asked for.
    asked: u32,
    /// The letter has a number.
    valued: u32,
    /// Units of a [`Decimal`]: zeros are cheaper to write than the numbers that they represent.
    values: [i64; 26],
}

/// Number for a tool that no machine has.
const NO_TOOL: u8 = u8::MAX;

/// The bit of an upper-case letter.
const fn bit(letter: u8) -> u32 {
    1 << (letter - b'A')
}

impl<'a> Words<'a> {
    /// No words.
    pub(super) fn new(remarks: &'a mut Remarks) -> Self {
        Words { remarks, present: 0, asked: 0, valued: 0, values: [0; 26] }
    }

    pub(super) fn parse(text: &str, remarks: &'a mut Remarks, strays: Strays) -> Result<Self, ParseError> {
        let mut words = Words::new(remarks);
        words.read(text, strays)?;
        Ok(words)
    }

    /// Reads the words of a line into an empty list, in place, for it has 220 bytes. A second
    /// command ends them, because its words would count as the first one's. A letter without a
    /// number does not remove the number of the same letter before it.
    pub(super) fn read(&mut self, text: &str, strays: Strays) -> Result<(), ParseError> {
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
                let stray = matches!(upper, b'0'..=b'9' | b'.' | b'-' | b'+') && strays != Strays::Refused;
                let (length, number) = Decimal::parse_prefix(bytes.get(at..).unwrap_or_default());
                if !stray || number.is_err() {
                    return Err(ParseError::UnexpectedCharacter(char_at(text, at)));
                }
                words.remarks.add(Remark::NoLetter);
                at += length;
                continue;
            }
            if matches!(upper, b'G' | b'M') {
                words.remarks.add(Remark::SecondCommand);
                break;
            }
            if let Some(not_finite) = not_finite(text, at + 1) {
                return Err(ParseError::NotANumber { letter: char::from(upper), text: not_finite });
            }
            at = skip_blanks(bytes, at + 1);
            let (bit, index) = (bit(upper), usize::from(upper - b'A'));
            words.present |= bit;
            if !begins_number(bytes, at) {
                if strays != Strays::Refused {
                    at = after_quotes(bytes, at);
                }
                if strays != Strays::Assigned || bytes.get(at) != Some(&b'=') {
                    continue;
                }
                at = skip_blanks(bytes, at + 1);
                if !begins_number(bytes, at) {
                    continue;
                }
            }
            let (length, number) = Decimal::parse_prefix(bytes.get(at..).unwrap_or_default());
            words.valued |= bit;
            words.values[index] = match number {
                Ok(value) => value.nanos(),
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
        Ok(())
    }

    /// True if there is no word.
    pub(super) fn is_empty(&self) -> bool {
        self.present == 0
    }

    /// The number of a letter, 0 without one.
    const fn number(&self, letter: u8) -> Decimal {
        Decimal::from_nanos(self.values[(letter - b'A') as usize])
    }

    /// True if the letter is there, with or without a number.
    pub(super) const fn has(&mut self, letter: u8) -> bool {
        self.asked |= bit(letter);
        self.present & bit(letter) != 0
    }

    /// True if the letter is there; does not count as asking for it.
    pub(super) const fn is_present(&self, letter: u8) -> bool {
        self.present & bit(letter) != 0
    }

    /// True if the letter is there with another number than this one, with which it
    /// needs no remark.
    pub(super) fn is_other_than(&mut self, letter: u8, usual: i64) -> bool {
        let value = self.number(letter);
        let is_other = self.is_present(letter) && value != Decimal::from_nanos(usual * 1_000_000_000);
        if !is_other {
            self.needless(letter);
        }
        is_other
    }

    /// True if the letter has a number of at least `least`; does not count as asking for it.
    pub(super) fn is_above(&self, letter: u8, least: i64) -> bool {
        self.valued & bit(letter) != 0 && self.number(letter) >= Decimal::from_nanos(least * 1_000_000_000)
    }

    /// Suppresses the remark for a word that asks for the present state.
    pub(super) const fn needless(&mut self, letter: u8) {
        self.asked |= bit(letter);
    }

    /// Suppresses the remark for a word that asks for the present state if its number is zero.
    pub(super) fn needless_zero(&mut self, letter: u8) {
        let bit = bit(letter);
        if self.valued & bit != 0 && self.number(letter) == Decimal::ZERO {
            self.asked |= bit;
        }
    }

    /// Suppresses remarks about words that are never asked for.
    pub(super) const fn forgive(&mut self) {
        self.asked = u32::MAX;
    }

    /// The number of a word, 0 where it has none.
    pub(super) fn value_or_zero(&mut self, letter: u8) -> Option<Decimal> {
        if !self.has(letter) {
            return None;
        }
        if self.valued & bit(letter) == 0 {
            self.remarks.add(Remark::Zero(letter));
        }
        Some(self.number(letter))
    }

    /// The number of a word. A letter without one is ignored, as in Marlin.
    pub(super) fn value(&mut self, letter: u8) -> Option<Decimal> {
        self.asked |= bit(letter);
        if self.valued & bit(letter) != 0 {
            return Some(self.number(letter));
        }
        if self.present & bit(letter) != 0 {
            self.remarks.add(Remark::NoNumber(letter));
        }
        None
    }

    /// A number above zero. Others would stop all motion and are ignored.
    pub(super) fn above_zero(&mut self, letter: u8) -> Option<Decimal> {
        let value = self.value(letter)?;
        if value <= Decimal::ZERO {
            self.remarks.add(Remark::NotAboveZero(letter));
            return None;
        }
        Some(value)
    }

    /// A number above zero.
    pub(super) fn required_above_zero(&mut self, letter: u8) -> Result<Option<Decimal>, ParseError> {
        match self.value(letter) {
            Some(value) if value <= Decimal::ZERO => {
                Err(ParseError::NotAboveZero { letter: char::from(letter), value })
            }
            value => Ok(value),
        }
    }

    /// A number that is not negative.
    pub(super) fn not_negative(&mut self, letter: u8) -> Result<Option<Decimal>, ParseError> {
        match self.value(letter) {
            Some(value) if value.is_negative() => Err(ParseError::BelowZero { letter: char::from(letter), value }),
            value => Ok(value),
        }
    }

    /// A target, degrees Celsius. Below 0 it is off, as other firmwares write it.
    pub(super) fn target(&mut self, letter: u8) -> Option<Decimal> {
        let value = self.value(letter)?;
        if value.is_negative() {
            self.remarks.add(Remark::BelowZeroIsOff);
            return Some(Decimal::ZERO);
        }
        Some(value)
    }

    /// A whole number; a fraction is dropped, as in Marlin.
    pub(super) fn whole(&mut self, letter: u8) -> Option<i64> {
        let value = self.value(letter)?;
        if value.to_i64_exact().is_none() {
            self.remarks.add(Remark::Fraction(letter));
        }
        Some(value.to_i64_towards_zero())
    }

    /// A whole number from 0 to `high`.
    pub(super) fn whole_to(&mut self, letter: u8, high: u8) -> Result<Option<u8>, ParseError> {
        let Some(whole) = self.whole(letter) else { return Ok(None) };
        match u8::try_from(whole) {
            Ok(whole) if whole <= high => Ok(Some(whole)),
            _ => Err(self.out_of_range(letter, 0, u16::from(high))),
        }
    }

    /// A whole number from 0 to `high`, which may be above 255.
    pub(super) fn whole_up_to(&mut self, letter: u8, high: u16) -> Result<Option<u16>, ParseError> {
        let Some(whole) = self.whole(letter) else { return Ok(None) };
        match u16::try_from(whole) {
            Ok(whole) if whole <= high => Ok(Some(whole)),
            _ => Err(self.out_of_range(letter, 0, high)),
        }
    }

    /// A number from 0 to 255, rounded to the nearest whole one; larger ones are 255, as in Marlin.
    pub(super) fn nearest_byte(&mut self, letter: u8) -> Result<Option<u8>, ParseError> {
        let Some(value) = self.value(letter) else { return Ok(None) };
        // -0.3 would round to 0, but is refused as well.
        if value.is_negative() {
            return Err(self.out_of_range(letter, 0, 255));
        }
        Ok(Some(u8::try_from(value.round_scaled(1)).unwrap_or_else(|_| {
            self.remarks.add(Remark::TooLarge(letter));
            u8::MAX
        })))
    }

    /// Adds a remark for a power above 0 and at most 1: RepRapFirmware's full power is 1.
    pub(super) fn remark_small_power(&mut self, letter: u8) {
        let is_valued = self.valued & bit(letter) != 0;
        if is_valued && (1..=1_000_000_000).contains(&self.number(letter).nanos()) {
            self.remarks.add(Remark::SmallPower);
        }
    }

    /// 0 or 1.
    pub(super) fn switch(&mut self, letter: u8) -> Result<Option<bool>, ParseError> {
        Ok(self.whole_to(letter, 1)?.map(|value| value == 1))
    }

    /// A number that is at most `high`.
    pub(super) fn at_most(&self, letter: u8, value: Option<Decimal>, high: u16) -> Result<Option<Decimal>, ParseError> {
        match value {
            Some(value) if value > Decimal::from_nanos(i64::from(high) * 1_000_000_000) => {
                Err(self.out_of_range(letter, 0, high))
            }
            value => Ok(value),
        }
    }

    /// A number that is not negative, times `factor` (1 or 1000), rounded to the nearest whole one.
    pub(super) fn nearest(&mut self, letter: u8, factor: i64) -> Result<Option<u64>, ParseError> {
        Ok(self.not_negative(letter)?.map(|value| value.round_scaled(factor).unsigned_abs()))
    }

    /// X, Y, Z and E.
    pub(super) fn axes(&mut self) -> AxisWords {
        AxisWords { x: self.value(b'X'), y: self.value(b'Y'), z: self.value(b'Z'), e: self.value(b'E') }
    }

    /// X, Y, Z and E; values that are not above zero are ignored.
    pub(super) fn axis_limits(&mut self) -> AxisWords {
        AxisWords {
            x: self.above_zero(b'X'),
            y: self.above_zero(b'Y'),
            z: self.above_zero(b'Z'),
            e: self.above_zero(b'E'),
        }
    }

    /// Axes named among X, Y, Z and E.
    pub(super) const fn axis_flags(&mut self) -> AxisFlags {
        AxisFlags { x: self.has(b'X'), y: self.has(b'Y'), z: self.has(b'Z'), e: self.has(b'E') }
    }

    /// Tool that the line names by T, or by another letter; numbers that no tool can have
    /// become [`NO_TOOL`].
    pub(super) fn tool(&mut self, letter: u8) -> Option<u8> {
        self.whole(letter).map(|number| u8::try_from(number).unwrap_or(NO_TOOL))
    }

    /// True if a letter has a number other than zero.
    pub(super) fn is_not_zero(&mut self, letter: u8) -> bool {
        self.value(letter).is_some_and(|value| value != Decimal::ZERO)
    }

    /// A letter that switches something on, alone or with a number other than zero.
    pub(super) fn flag(&mut self, letter: u8) -> bool {
        self.has(letter) && (self.valued & bit(letter) == 0 || self.number(letter) != Decimal::ZERO)
    }

    /// The remarks about the line.
    pub(super) fn remarks(&mut self) -> &mut Remarks {
        self.remarks
    }

    /// Leaves a remark about the line.
    pub(super) fn remark(&mut self, remark: Remark) {
        self.remarks.add(remark);
    }

    fn out_of_range(&self, letter: u8, low: u16, high: u16) -> ParseError {
        let value = self.number(letter);
        ParseError::OutOfRange { letter: char::from(letter), value, low, high }
    }
}

impl Drop for Words<'_> {
    /// Remarks that the words never asked for have no effect.
    fn drop(&mut self) {
        self.remarks.add_no_effect(self.present & !self.asked);
    }
}

/// `nan` or `inf` after a letter, as programs print numbers that they failed to compute: no
/// words are meant by `Xnan`, and the move must not go elsewhere without it.
#[inline]
fn not_finite(text: &str, at: usize) -> Option<ShortText> {
    let bytes = text.as_bytes();
    if !matches!(bytes.get(at), Some(b'n' | b'N' | b'i' | b'I')) {
        return None;
    }
    let name = text.get(at..at + 3)?;
    ["nan", "inf"].iter().any(|not_finite| name.eq_ignore_ascii_case(not_finite)).then(|| ShortText::new(name))
}

/// The place after a text in `"`, as Prusa's firmware takes it after a letter; without one `at`.
#[cold]
fn after_quotes(bytes: &[u8], at: usize) -> usize {
    let text = bytes.get(at..).and_then(|rest| rest.strip_prefix(b"\""));
    let length = text.and_then(|text| text.iter().position(|byte| *byte == b'"'));
    length.map_or(at, |length| at + length + 2)
}

#[inline]
fn begins_number(bytes: &[u8], at: usize) -> bool {
    matches!(bytes.get(at), Some(b'0'..=b'9' | b'.' | b'-' | b'+'))
}

/// The first place from `at` on that is not a space, tab or `( )` comment; an unclosed comment
/// extends to the end.
#[inline]
pub(super) fn skip_blanks(bytes: &[u8], mut at: usize) -> usize {
    while let Some(&byte) = bytes.get(at) {
        match byte {
            b' ' | b'\t' => at += 1,
            // A blank of a page of the web, from which end code was copied.
            0xC2 if bytes.get(at + 1) == Some(&0xA0) => at += 2,
            b'(' => {
                let rest = bytes.get(at..).unwrap_or_default();
                at += rest.iter().position(|&byte| byte == b')').map_or(rest.len(), |end| end + 1);
            }
            _ => break,
        }
    }
    at
}

/// The character that begins at `at`.
fn char_at(text: &str, at: usize) -> char {
    text.get(at..).and_then(|rest| rest.chars().next()).unwrap_or(char::REPLACEMENT_CHARACTER)
}
