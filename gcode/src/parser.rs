//! From the text of a line to a [`Command`].

mod g_codes;
mod m_codes;
mod words;

use crate::{Command, ParseError, Remarks};

/// What stands at the start of a line: `G29.1`, `M204`, `T0`.
#[derive(Clone, Copy)]
struct Code<'a> {
    /// The number after the letter, `u32::MAX` if it is larger still.
    number: u32,
    /// Whether `.` and a subcode follow.
    has_subcode: bool,
    /// The whole line, trimmed.
    text: &'a str,
    /// What follows the code.
    rest: &'a str,
}

/// Reads one line, without its number, checksum and `;` comment, as [`Line::text`](crate::Line::text) has it.
///
/// Words stand in any order, with or without spaces, in upper or lower case; the last of two words with the same
/// letter counts. `( )` comments are skipped, and the line ends at a `*`, except in the text of M117 and M118. A line
/// without content is [`Command::Accepted`]; an unknown command is
/// [`Command::Unknown`].
///
/// # Errors
///
/// [`ParseError`] where a word of a known command is missing, malformed or out of range, for text that is no command at
/// all, and for commands that cannot be skipped because the rest of the job would print elsewhere.
pub fn parse(text: &str) -> Result<Command<'_>, ParseError> {
    parse_with_remarks(text, &mut Remarks::default())
}

/// As [`parse`]; adds to `remarks` which parts of the line are ignored or changed, for the host.
///
/// # Errors
///
/// As [`parse`].
pub fn parse_with_remarks<'a>(text: &'a str, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let bytes = text.as_bytes();
    let mut at = words::skip_blanks(bytes, 0);
    let letter = match bytes.get(at) {
        None | Some(b'*' | b';') => return Ok(Command::Accepted),
        Some(byte) if byte.is_ascii_alphabetic() => byte.to_ascii_uppercase(),
        // Programs for other machines begin and end with it.
        Some(b'%') => return Ok(Command::Unknown(text.trim_matches([' ', '\t']))),
        Some(_) => {
            let found = char_at(text, at);
            return Err(ParseError::CommandLetterExpected { found });
        }
    };
    at = words::skip_blanks(bytes, at + 1);
    let digits_start = at;
    let mut number: u32 = 0;
    while let Some(&byte @ b'0'..=b'9') = bytes.get(at) {
        number = number.saturating_mul(10).saturating_add(u32::from(byte - b'0'));
        at += 1;
    }
    let has_number = at > digits_start;
    let has_subcode = has_number && bytes.get(at) == Some(&b'.');
    if has_subcode {
        at += 1;
        while matches!(bytes.get(at), Some(b'0'..=b'9')) {
            at += 1;
        }
    }
    let code = Code { number, has_subcode, text, rest: text.get(at..).unwrap_or_default() };
    match letter {
        b'G' | b'M' if !has_number => Err(ParseError::NumberExpected { letter: char::from(letter) }),
        b'G' => g_codes::parse(code, remarks),
        b'M' => m_codes::parse(code, remarks),
        // `Tx`, `Tc` and `T?` drive the filament changer of some printers.
        b'T' if has_number && !has_subcode => {
            if number == u32::MAX {
                let text = crate::ShortText::new(text.get(digits_start..at).unwrap_or_default());
                return Err(ParseError::TooLarge { letter: 'T', text });
            }
            Ok(Command::SelectTool(number))
        }
        _ => Ok(code.unknown()),
    }
}

impl<'a> Code<'a> {
    fn unknown(&self) -> Command<'a> {
        Command::Unknown(self.text.trim_matches([' ', '\t']))
    }

    /// The rest of the line as text.
    fn free_text(&self) -> &'a str {
        self.rest.trim_matches([' ', '\t'])
    }

    fn words<'r>(&self, remarks: &'r mut Remarks) -> Result<words::Words<'r>, ParseError> {
        words::Words::parse(self.rest, remarks)
    }

    /// Checks that what follows is well formed, for a command that has no words.
    fn without_words(&self, command: Command<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
        self.words(remarks).map(|_| command)
    }
}

/// The character that begins at `at`.
fn char_at(text: &str, at: usize) -> char {
    text.get(at..).and_then(|rest| rest.chars().next()).unwrap_or(char::REPLACEMENT_CHARACTER)
}

#[cfg(test)]
mod round_trip;
#[cfg(test)]
mod tests;
