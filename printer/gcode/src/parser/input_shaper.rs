//! M593, as Marlin and RepRapFirmware have it; which of them is meant, the words say.

use super::code::Code;
use super::words::{Strays, Words, skip_blanks};
use crate::{Command, ParseError, ShaperWords};

/// A line whose P has the name of a kind in quotes.
struct Quoted<'a> {
    before: &'a str,
    name: &'a str,
    after: &'a str,
}

/// Reads the words after M593.
#[inline(never)]
pub(super) fn parse<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let quoted = quoted(code.rest);
    words.read(quoted.as_ref().map_or(code.rest, |quoted| quoted.before), Strays::Remarked)?;
    if let Some(quoted) = &quoted {
        words.read(quoted.after, Strays::Remarked)?;
    }
    if words.has(b'P') {
        return Err(ParseError::WordsExpected { command: "M593", words: "P with a kind in quotes, such as P\"mzv\"" });
    }
    let [x, y] = [words.has(b'X'), words.has(b'Y')];
    if !x && !y && (words.has(b'Z') || words.has(b'E')) {
        let why = "X and Y have filters; name X or Y, or neither for both";
        return Err(ParseError::NotSupported { command: "M593 of Z and E", why });
    }
    let (frequency, ratio, damping) = (words.value(b'F'), words.value(b'D'), words.value(b'S'));
    if ratio.is_some() && damping.is_some() {
        let why = "both are the damping; write one of them";
        return Err(ParseError::NotSupported { command: "M593 with D and S", why });
    }
    let changes = ShaperWords { kind: quoted.map(|quoted| quoted.name), frequency, damping: ratio.or(damping) };
    let all = !x && !y;
    let axes = [x, y].map(|is_named| if is_named || all { changes } else { ShaperWords::default() });
    Ok(Command::InputShaper { axes, usual: "zv" })
}

/// First P followed by a quote, among the words that count; an unclosed quote does not count.
fn quoted(text: &str) -> Option<Quoted<'_>> {
    let bytes = text.as_bytes();
    let mut at = 0;
    loop {
        at = skip_blanks(bytes, at);
        match bytes.get(at)?.to_ascii_uppercase() {
            // The line's end, and a second command.
            b'*' | b';' | b'G' | b'M' => return None,
            b'P' if bytes.get(skip_blanks(bytes, at + 1)) == Some(&b'"') => {
                let start = skip_blanks(bytes, at + 1) + 1;
                let (name, after) = text.get(start..)?.split_once('"')?;
                return Some(Quoted { before: text.get(..at)?, name, after });
            }
            _ => at += 1,
        }
    }
}
