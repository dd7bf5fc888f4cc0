//! Errors of lines that cannot be read as a command.

use core::fmt;

use crate::Decimal;

/// Bytes a [`ShortText`] keeps.
const SHORT_TEXT_CAPACITY: usize = 24;

/// The start of a piece of the line, kept so that an error outlives the line.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct ShortText {
    bytes: [u8; SHORT_TEXT_CAPACITY],
    length: u8,
    cut: bool,
}

impl ShortText {
    /// The first characters of `text`, at most 24 bytes.
    pub fn new(text: &str) -> Self {
        let mut length = text.len().min(SHORT_TEXT_CAPACITY);
        while !text.is_char_boundary(length) {
            length -= 1;
        }
        let mut bytes = [0; SHORT_TEXT_CAPACITY];
        for (to, from) in bytes.iter_mut().zip(text.bytes().take(length)) {
            *to = from;
        }
        ShortText { bytes, length: length as u8, cut: length < text.len() }
    }

    /// The characters kept.
    pub fn as_str(&self) -> &str {
        self.bytes
            .get(..usize::from(self.length))
            .and_then(|bytes| core::str::from_utf8(bytes).ok())
            .unwrap_or_default()
    }
}

impl fmt::Display for ShortText {
    /// The characters kept, with `...` where some are missing.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.as_str())?;
        if self.cut { formatter.write_str("...") } else { Ok(()) }
    }
}

impl fmt::Debug for ShortText {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), formatter)
    }
}

/// Reason why a line cannot be read as a command. `Display` names the word and what
/// was expected there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParseError {
    /// A character with which no word can begin.
    UnexpectedCharacter(char),
    /// G or M without its number.
    NumberExpected {
        /// The letter, upper case.
        letter: char,
    },
    /// Digits, points or signs follow the letter, but they do not form a number.
    NotANumber {
        /// The letter, upper case.
        letter: char,
        /// Text after it.
        text: ShortText,
    },
    /// The number does not fit a [`Decimal`] or its field.
    TooLarge {
        /// The letter, upper case.
        letter: char,
        /// The number.
        text: ShortText,
    },
    /// Zero or less where the number must be above zero.
    NotAboveZero {
        /// The letter, upper case.
        letter: char,
        /// The number.
        value: Decimal,
    },
    /// A negative number where it must be zero or more.
    BelowZero {
        /// The letter, upper case.
        letter: char,
        /// The number.
        value: Decimal,
    },
    /// A number outside its range.
    OutOfRange {
        /// The letter, upper case.
        letter: char,
        /// The number.
        value: Decimal,
        /// Smallest allowed.
        low: u16,
        /// Largest allowed.
        high: u16,
    },
    /// Words that the command requires are missing.
    WordsExpected {
        /// The command, such as `G4`.
        command: &'static str,
        /// The words, such as `P or S`.
        words: &'static str,
    },
    /// A line of coordinates alone, with which other machines repeat the last G0 to G3.
    BareCoordinate,
    /// A word that the command does not have, where one is missing.
    UnknownWord {
        /// The command.
        command: &'static str,
        /// The word.
        word: ShortText,
        /// Form of its words.
        words: &'static str,
    },
    /// A word that a macro of the profile does not know.
    UnknownParameter {
        /// The macro.
        command: &'static str,
        /// The word.
        word: ShortText,
        /// Words that it knows, each with its default, such as `BED=60`.
        known: &'static str,
    },
    /// A command that cannot be skipped: the rest of the job would print elsewhere, or with more
    /// or less filament.
    NotSupported {
        /// The command, such as `G5`.
        command: &'static str,
        /// Effect of skipping it, and what to write instead.
        why: &'static str,
    },
}

impl fmt::Display for ParseError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ParseError::UnexpectedCharacter(character) => {
                write!(formatter, "unexpected character '{character}', expected a letter and its number")
            }
            ParseError::NumberExpected { letter } => {
                write!(formatter, "{letter} without a number, expected a command such as {letter}1")
            }
            ParseError::NotANumber { letter, text } => {
                write!(formatter, "{letter}: \"{text}\" is not a number, expected one like 12.5 or -.8")
            }
            ParseError::TooLarge { letter, text } => {
                write!(formatter, "{letter}: {text} is too large, expected at most 9 digits before the point")
            }
            ParseError::NotAboveZero { letter, value } => {
                write!(formatter, "{letter}: {value} is out of range, expected more than 0")
            }
            ParseError::BelowZero { letter, value } => {
                write!(formatter, "{letter}: {value} is out of range, expected 0 or more")
            }
            ParseError::OutOfRange { letter, value, low, high } => {
                write!(formatter, "{letter}: {value} is out of range, expected {low} to {high}")
            }
            ParseError::WordsExpected { command, words } => {
                write!(formatter, "{command}: expected {words}")
            }
            ParseError::BareCoordinate => formatter.write_str("a coordinate without a command: write G1 before it"),
            ParseError::UnknownWord { command, word, words } => {
                write!(formatter, "{command}: unknown word \"{word}\", expected {words}")
            }
            ParseError::UnknownParameter { command, word, known: "" } => {
                write!(formatter, "{command}: unknown word \"{word}\": the macro takes no words")
            }
            ParseError::UnknownParameter { command, word, known } => {
                write!(formatter, "{command}: unknown word \"{word}\", expected one or more of {known}")
            }
            ParseError::NotSupported { command, why } => write!(formatter, "{command}: not supported, {why}"),
        }
    }
}

impl core::error::Error for ParseError {}
