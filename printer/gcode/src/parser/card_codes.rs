//! Commands for the files on a memory card.

use super::code::Code;
use super::words::{Strays, Words, skip_blanks};
use crate::{CardCommand, InterruptedPrint, ParseError};

/// Maximum interval of M27, seconds.
const MAX_INTERVAL_S: u8 = 60;

/// M20 to M34, M413, M524, M928, M1000; `None` for any other.
pub(super) fn parse<'a>(code: &Code<'a>, words: &mut Words<'_>) -> Option<Result<CardCommand<'a>, ParseError>> {
    Some(match code.number {
        20 => flags(code),
        21 => Ok(CardCommand::Mount),
        22 => Ok(CardCommand::Release),
        23 => path(code, "M23").map(CardCommand::Select),
        24 => position(code, words).map(|position| CardCommand::Start { position }),
        25 => Ok(CardCommand::Pause),
        26 => position(code, words).and_then(|position| {
            let missing = ParseError::WordsExpected { command: "M26", words: "S" };
            position.map(CardCommand::SetPosition).ok_or(missing)
        }),
        27 => progress(code, words),
        28 => path(code, "M28").map(CardCommand::Write),
        29 => Ok(CardCommand::EndWrite),
        // Alone it ends a program, which needs no command here.
        30 if skip_blanks(code.rest.as_bytes(), 0) == code.rest.len() => return None,
        30 => path(code, "M30").map(CardCommand::Delete),
        31 => Ok(CardCommand::ReportTime),
        32 => select_and_start(code, words),
        33 => path(code, "M33").map(CardCommand::ReportLongPath),
        34 => Ok(CardCommand::Sort),
        413 => code.words(words).and_then(|words| words.switch(b'S')).map(CardCommand::KeepPlace),
        524 => Ok(CardCommand::Abort),
        928 => path(code, "M928").map(CardCommand::Log),
        1000 => code.words(words).map(|words| {
            let (discards, reports) = (words.flag(b'C'), words.flag(b'S'));
            CardCommand::Interrupted(match (discards, reports) {
                (true, _) => InterruptedPrint::Discard,
                (false, true) => InterruptedPrint::Report,
                (false, false) => InterruptedPrint::Resume,
            })
        }),
        _ => return None,
    })
}

/// M20: letters without numbers.
fn flags<'a>(code: &Code<'a>) -> Result<CardCommand<'a>, ParseError> {
    let has = |letter: char| code.free_text().chars().any(|char| char.eq_ignore_ascii_case(&letter));
    Ok(CardCommand::List { long: has('L'), time: has('T') })
}

/// A path, which is the rest of the line.
fn path<'a>(code: &Code<'a>, command: &'static str) -> Result<&'a str, ParseError> {
    let text = code.free_text();
    if text.is_empty() { Err(ParseError::WordsExpected { command, words: "a file's name" }) } else { Ok(text) }
}

fn position(code: &Code<'_>, words: &mut Words<'_>) -> Result<Option<u32>, ParseError> {
    let words = code.words(words)?;
    // A length beyond any file's: no file has such a place.
    Ok(words.nearest(b'S', 1)?.map(|position| u32::try_from(position).unwrap_or(u32::MAX)))
}

/// M27: C asks for the name, S sets the interval.
fn progress<'a>(code: &Code<'a>, words: &mut Words<'_>) -> Result<CardCommand<'a>, ParseError> {
    if code.free_text().starts_with(['C', 'c']) {
        return Ok(CardCommand::ReportFile);
    }
    let interval = code.words(words)?.whole_to(b'S', MAX_INTERVAL_S)?;
    Ok(interval.map_or(CardCommand::ReportProgress, |seconds| CardCommand::AutoReport { seconds }))
}

/// True if a text consists of words of M32, each a letter with or without a number.
fn is_words(text: &str) -> bool {
    let is_word = |word: &str| match word.as_bytes() {
        [b'P' | b'S' | b'p' | b's', number @ ..] => number.iter().all(u8::is_ascii_digit),
        _ => false,
    };
    text.split_ascii_whitespace().all(is_word)
}

/// Splits a path from the `#` that ends it, and from the text after it. A name may
/// contain `#` as well.
fn before_end_mark(text: &str) -> &str {
    let ends =
        |place: &usize| text.get(place + 1..).is_some_and(|rest| rest.is_empty() || rest.starts_with([' ', '\t']));
    let end = text.rmatch_indices('#').map(|(place, _)| place).find(ends);
    text.get(..end.unwrap_or(text.len())).unwrap_or_default()
}

/// M32: the path is between `!` and `#`, or is the rest of the line.
fn select_and_start<'a>(code: &Code<'a>, words: &mut Words<'_>) -> Result<CardCommand<'a>, ParseError> {
    let text = code.free_text();
    let (before, path) = match text.split_once('!') {
        Some((before, path)) if is_words(before) => (before, before_end_mark(path)),
        _ => ("", text),
    };
    let path = path.trim_matches([' ', '\t']);
    if path.is_empty() {
        return Err(ParseError::WordsExpected { command: "M32", words: "a file's name after !" });
    }
    words.read(before, Strays::Remarked)?;
    if words.has(b'P') {
        let why = "a file that is printed from within another would leave its place; print one after the other";
        return Err(ParseError::NotSupported { command: "M32 P", why });
    }
    let position = words.nearest(b'S', 1)?.map(|position| u32::try_from(position).unwrap_or(u32::MAX));
    Ok(CardCommand::SelectAndStart { path, position })
}
