//! Motion and geometry.

use super::Code;
use super::words::Words;
use crate::{ArcForm, Command, Decimal, ParseError, Units};

pub(super) fn parse(code: Code<'_>) -> Result<Command<'_>, ParseError> {
    if code.has_subcode {
        // G29.1 and the like belong to bed levelling, as G29 itself.
        return Ok(if code.number == 29 { Command::Accepted } else { code.unknown() });
    }
    match code.number {
        0 | 1 => {
            let mut words = Words::NONE;
            words.read(code.rest)?;
            Ok(Command::Linear { rapid: code.number == 0, axes: words.axes()?, feed: words.above_zero(b'F')? })
        }
        2 => arc(code, true),
        3 => arc(code, false),
        4 => dwell(code),
        10 => retract_or_recover(code, Command::Retract),
        11 => retract_or_recover(code, Command::Recover),
        18 | 19 => Err(ParseError::PlaneNotSupported),
        20 => code.without_words(Command::SetUnits(Units::Inches)),
        21 => code.without_words(Command::SetUnits(Units::Millimetres)),
        28 => Ok(Command::Home(code.words()?.axis_flags())),
        // Bed levelling: start scripts ask for it whether or not the machine has it.
        29 => Ok(Command::Accepted),
        17 | 54 | 80 => code.without_words(Command::Accepted),
        // In front of a move G53 asks for machine coordinates, and the move must not vanish silently.
        53 if super::words::skip_blanks(code.rest.as_bytes(), 0) == code.rest.len() => Ok(Command::Accepted),
        90 => code.without_words(Command::AbsolutePositioning),
        91 => code.without_words(Command::RelativePositioning),
        92 => Ok(Command::SetPosition(code.words()?.axes()?)),
        _ => Ok(code.unknown()),
    }
}

fn arc(code: Code<'_>, clockwise: bool) -> Result<Command<'_>, ParseError> {
    let words = code.words()?;
    // P asks for more full circles, K for an arc in another plane.
    for letter in [b'P', b'K'] {
        if words.value(letter)?.is_some_and(|value| value != Decimal::ZERO) {
            return Ok(code.unknown());
        }
    }
    let form = match (words.value(b'R')?, words.value(b'I')?, words.value(b'J')?) {
        (Some(radius), _, _) => ArcForm::Radius(radius),
        (None, None, None) => {
            let command = if clockwise { "G2" } else { "G3" };
            return Err(ParseError::WordsExpected { command, words: "I and J, or R" });
        }
        (None, i, j) => ArcForm::Centre { i: i.unwrap_or_default(), j: j.unwrap_or_default() },
    };
    Ok(Command::Arc { clockwise, axes: words.axes()?, form, feed: words.above_zero(b'F')? })
}

fn dwell(code: Code<'_>) -> Result<Command<'_>, ParseError> {
    let words = code.words()?;
    let from_milliseconds = words.nearest(b'P', 1)?;
    let from_seconds = words.nearest(b'S', 1000)?;
    match from_seconds.or(from_milliseconds) {
        Some(milliseconds) => Ok(Command::Dwell { milliseconds }),
        None => Err(ParseError::WordsExpected { command: "G4", words: "P or S" }),
    }
}

/// G10 and G11; with L, P or R they set tool offsets on other machines.
fn retract_or_recover<'a>(code: Code<'a>, command: Command<'a>) -> Result<Command<'a>, ParseError> {
    let words = code.words()?;
    let sets_offsets = [b'L', b'P', b'R'].iter().any(|&letter| words.has(letter));
    Ok(if sets_offsets { code.unknown() } else { command })
}
