//! Parsing of a line's text into a [`Command`].

mod accelerometer;
mod bed;
mod card_codes;
mod code;
mod drivers;
mod g_codes;
mod heater_model;
mod input_shaper;
mod m_codes;
mod named;
mod pin;
mod pressure_advance;
mod words;

use crate::remarks::{Remark, Remarks};
use crate::{Command, NotExecuted, ParseError};
use code::Code;
pub use heater_model::HeaterModelWords;
use words::Words;

/// Reads one line, without its number, checksum and `;` comment, as
/// [`Line::text`](crate::Line::text) has it.
///
/// Words may come in any order, with or without spaces, in upper or lower case; the last of two
/// words with the same letter counts. `( )` comments are skipped, and the line ends at a `*`,
/// except in the text of M117 and M118. A line without content is [`Command::Accepted`]; an unknown
/// command is [`Command::Unknown`].
///
/// # Errors
///
/// [`ParseError`] if a word of a known command is missing, malformed or out of range, for text that
/// is not a command at all, and for commands that cannot be skipped because the rest of the job
/// would print elsewhere.
pub fn parse(text: &str) -> Result<Command<'_>, ParseError> {
    parse_with_remarks(text, &mut Remarks::default())
}

/// Parses like [`parse`], and adds to `remarks`, for the host, which parts of the line are ignored
/// or changed and what has no effect.
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
        _ => return Ok(no_command(text, at, remarks)),
    };
    let word = at;
    at = words::skip_blanks(bytes, at + 1);
    let digits_start = at;
    let mut number: u32 = 0;
    while let Some(&byte @ b'0'..=b'9') = bytes.get(at) {
        number = number.saturating_mul(10).saturating_add(u32::from(byte - b'0'));
        at += 1;
    }
    let has_number = at > digits_start;
    let mut subcode: u32 = 0;
    let has_subcode = has_number && bytes.get(at) == Some(&b'.');
    if has_subcode {
        at += 1;
        while let Some(&byte @ b'0'..=b'9') = bytes.get(at) {
            subcode = subcode.saturating_mul(10).saturating_add(u32::from(byte - b'0'));
            at += 1;
        }
    }
    let code = Code { number, has_subcode, subcode, text, rest: text.get(at..).unwrap_or_default(), letter };
    match letter {
        b'G' | b'M' if !has_number && is_name(bytes.get(word..).unwrap_or_default()) => named::parse(&code, remarks),
        b'G' | b'M' if !has_number => Err(ParseError::NumberExpected { letter: char::from(letter) }),
        b'G' => g_codes::parse(code, &mut Words::new(remarks)),
        b'M' => m_codes::parse(code, &mut Words::new(remarks)),
        // `Tx`, `Tc` and `T?` drive the filament changer of some printers, as numbers do
        // that no tool has.
        b'T' if has_number && !has_subcode && number <= LAST_TOOL => {
            let stays = code.peek(remarks)?.flag(b'S');
            Ok(Command::SelectTool { tool: Some(number), stays })
        }
        b'T' if !has_number && matches!(bytes.get(words::skip_blanks(bytes, at)), None | Some(b'*' | b';')) => {
            Ok(Command::SelectTool { tool: None, stays: false })
        }
        b'X' | b'Y' | b'Z' | b'E' if has_number || matches!(bytes.get(at), Some(b'-' | b'+' | b'.')) => {
            Err(ParseError::BareCoordinate)
        }
        _ => named::parse(&code, remarks),
    }
}

/// Highest number of a tool; higher ones are orders to some printers: T255 and T1000 of
/// Bambu's, T65535.
const LAST_TOOL: u32 = 99;

/// A line that begins with something other than a letter.
#[cold]
fn no_command<'a>(text: &'a str, at: usize, remarks: &mut Remarks) -> Command<'a> {
    let rest = text.get(at..).unwrap_or_default();
    if rest.starts_with('@') {
        remarks.add(Remark::HostCommand);
        return Command::Accepted;
    }
    if rest.starts_with("//") {
        remarks.add(Remark::SlashComment);
        return Command::Accepted;
    }
    Command::Unknown(text.trim_matches([' ', '\t']))
}

/// True if a word is a name, such as a macro of other firmware, and not a command that lost its
/// number: two letters follow each other after the first, as in `MESH_ON`, but not in `GX5Y5`.
fn is_name(word: &[u8]) -> bool {
    let is_letter = |byte: &u8| byte.is_ascii_alphabetic() || *byte == b'_';
    let word = word.split(|byte| matches!(byte, b' ' | b'\t')).next().unwrap_or_default();
    word.get(1..).unwrap_or_default().windows(2).any(|pair| pair.iter().all(is_letter))
}

impl NotExecuted {
    /// The entry of the command at the start of a line, such as `M92 E420`.
    pub fn of(text: &str) -> Option<&'static Self> {
        let mut remarks = Remarks::default();
        parse_with_remarks(text, &mut remarks).ok()?;
        remarks.entries().next()
    }
}

#[cfg(test)]
mod input_shaper_tests;
#[cfg(test)]
mod named_tests;
#[cfg(test)]
mod odd_line_tests;
#[cfg(test)]
mod round_trip;
#[cfg(test)]
mod tests;
