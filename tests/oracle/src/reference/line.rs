//! One line of G-code as a command and its words.

use super::decimal::{Decimal, OutOfRange};

/// A command letter, its number, and the words after it. Upper-case letters only; spaces are
/// optional; of two words with the same letter the last counts.
#[derive(Debug)]
pub struct Command<'a> {
    /// `G`, `M` or another letter.
    pub letter: u8,
    /// The number after the letter.
    pub number: u32,
    /// Text after each letter of the alphabet, if the letter was there.
    words: [Option<&'a [u8]>; 26],
}

impl<'a> Command<'a> {
    /// Reads a line without its line end. `None` for a line without a command, and for commands
    /// with a sub-code (`G92.1`): this interpreter executes none of them.
    pub fn parse(line: &'a [u8]) -> Option<Self> {
        let line = cut_at(line, b';');
        let mut rest = line.trim_ascii();
        if let Some((b'N', numbered)) = rest.split_first() {
            let digits = numbered.iter().take_while(|byte| byte.is_ascii_digit() || **byte == b'-').count();
            rest = numbered.get(digits..)?;
        }
        // The host's checksum follows the last asterisk and is not part of the command.
        rest = cut_at(rest, b'*').trim_ascii();
        let (&letter, rest) = rest.split_first()?;
        if !letter.is_ascii_uppercase() {
            return None;
        }
        let digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
        let number = std::str::from_utf8(rest.get(..digits)?).ok()?.parse().ok()?;
        let rest = rest.get(digits..)?;
        if rest.first() == Some(&b'.') {
            return None;
        }
        Some(Self { letter, number, words: words(rest) })
    }

    /// Returns true if the word was given, with or without a value.
    pub fn has(&self, letter: u8) -> bool {
        self.word(letter).is_some()
    }

    /// The value of a word; `None` if the word or its number is missing.
    ///
    /// # Errors
    /// As [`Decimal::parse_prefix`].
    pub fn value(&self, letter: u8) -> Result<Option<Decimal>, OutOfRange> {
        match self.word(letter) {
            Some(text) => Decimal::parse_prefix(text.trim_ascii_start()),
            None => Ok(None),
        }
    }

    fn word(&self, letter: u8) -> Option<&'a [u8]> {
        self.words.get(usize::from(letter.wrapping_sub(b'A'))).copied().flatten()
    }
}

fn cut_at(line: &[u8], end: u8) -> &[u8] {
    line.split(|&byte| byte == end).next().unwrap_or_default()
}

fn words(text: &[u8]) -> [Option<&[u8]>; 26] {
    let mut words = [None; 26];
    let mut rest = text;
    while let Some((&byte, behind)) = rest.split_first() {
        rest = behind;
        if byte.is_ascii_uppercase() {
            let length = behind.iter().take_while(|byte| !byte.is_ascii_uppercase()).count();
            let (value, next) = behind.split_at(length);
            if let Some(word) = words.get_mut(usize::from(byte - b'A')) {
                *word = Some(value);
            }
            rest = next;
        }
    }
    words
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn number(line: &str, letter: u8) -> f64 {
        Command::parse(line.as_bytes()).unwrap().value(letter).unwrap().unwrap().to_f64()
    }

    #[test]
    fn words_are_split_at_letters() {
        assert_eq!(number("G1 X10E5", b'X'), 10.0);
        assert_eq!(number("G1X10E5", b'E'), 5.0);
        assert_eq!(number("N12 G01 X 1.5 Y-.25*33", b'Y'), -0.25);
        assert_eq!(number("G1 X1 X2", b'X'), 2.0);
        assert_eq!(number("G1 E-.8 F2100 ; X9", b'F'), 2100.0);
        let command = Command::parse(b"G28 X Y ; home\r").unwrap();
        assert_eq!((command.letter, command.number), (b'G', 28));
        assert!(command.has(b'X') && command.has(b'Y') && !command.has(b'Z'));
        assert_eq!(command.value(b'X'), Ok(None));
    }

    #[test]
    fn lines_without_a_command_are_none() {
        for line in ["", "  ", "; note", "g1 X1", "G", "G X1", "G92.1", "N5", "*7", "G99999999999"] {
            assert!(Command::parse(line.as_bytes()).is_none(), "{line:?}");
        }
    }
}
