//! Motion and geometry.

use super::code::Code;
use super::words::{Strays, Words, skip_blanks};
use crate::remarks::{Remark, Remarks};
use crate::{ArcForm, AxisFlags, AxisWords, Command, Decimal, ParseError, Units};

pub(super) fn parse<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    if code.has_subcode {
        return match code.number {
            // G38.2, G59.1 and the like belong to G38 and G59.
            38 | 54..=59 => code.not_executed(words),
            0..=6 => Err(not_supported("G0.x to G6.x", "the move would be missing; use G0 to G3")),
            92 => Err(not_supported("G92.x", "the coordinates would stay as they are; use G92 with X, Y, Z or E")),
            53 => Err(not_supported("G53.x", "the part would lie elsewhere; use G92")),
            _ => Ok(code.unknown()),
        };
    }
    match code.number {
        0 | 1 => {
            words.read(code.rest, Strays::Refused)?;
            Ok(Command::Linear { rapid: code.number == 0, axes: words.axes(), feed: words.above_zero(b'F') })
        }
        2 => arc(code, true, words),
        3 => arc(code, false, words),
        4 => dwell(code, words),
        // Alone they name no curve and no steps.
        5 | 6 if skip_blanks(code.rest.as_bytes(), 0) == code.rest.len() => Ok(code.unknown()),
        10 => retract_or_recover(code, Command::Retract, words),
        11 => retract_or_recover(code, Command::Recover, words),
        20 => code.without_words(Command::SetUnits(Units::Inches), words),
        21 => code.without_words(Command::SetUnits(Units::Millimetres), words),
        28 => home(code, words),
        29 | 30 | 34 | 35 | 80 => super::bed::g_code(code, words),
        17 | 54 => {
            code.without_words(Command::Accepted, words)?;
            code.not_executed(words)
        }
        // G53 before a move means machine coordinates, and the move must not vanish silently.
        53 if skip_blanks(code.rest.as_bytes(), 0) < code.rest.len() => {
            Err(not_supported("G53 with a move", "the move would be missing; put the move on its own line"))
        }
        73 | 76 | 81..=89 if code.peek(&mut Remarks::default())?.axes() != AxisWords::default() => {
            Err(not_supported("G73 to G89", "the moves of the cycle would be missing; write G0 and G1"))
        }
        90 => code.without_words(Command::AbsolutePositioning, words),
        91 => code.without_words(Command::RelativePositioning, words),
        92 => set_position(code, words),
        _ => code.not_executed(words),
    }
}

const fn not_supported(command: &'static str, why: &'static str) -> ParseError {
    ParseError::NotSupported { command, why }
}

fn arc<'a>(code: Code<'a>, clockwise: bool, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.places(words)?;
    if words.is_not_zero(b'K') {
        return Err(not_supported("G2 and G3 with K", "the arc would be missing; write arcs in XY"));
    }
    // Slicers lift with P1, which is once around; some firmware counts the turns, some those
    // beyond the first.
    let turns = words.value(b'P').unwrap_or_default();
    if turns != Decimal::ZERO && turns != Decimal::from_nanos(1_000_000_000) {
        return Err(not_supported(
            "G2 and G3 with P other than 0 and 1",
            "P turns mean another path in each firmware; write a line for each turn",
        ));
    }
    let form = match (words.value(b'R'), words.value(b'I'), words.value(b'J')) {
        (Some(radius), _, _) => ArcForm::Radius(radius),
        (None, None, None) => {
            let command = if clockwise { "G2" } else { "G3" };
            return Err(ParseError::WordsExpected { command, words: "I and J, or R" });
        }
        (None, i, j) => ArcForm::Centre { i: i.unwrap_or_default(), j: j.unwrap_or_default() },
    };
    Ok(Command::Arc { clockwise, axes: words.axes(), form, feed: words.above_zero(b'F') })
}

fn dwell<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    let from_milliseconds = words.nearest(b'P', 1)?;
    let from_seconds = words.nearest(b'S', 1000)?;
    let milliseconds = from_seconds.or(from_milliseconds).unwrap_or_else(|| {
        words.remark(Remark::BareDwell);
        0
    });
    Ok(Command::Dwell { milliseconds })
}

/// Letters of axes that other machines have: `G28 U` homes that axis, and must not home X, Y and Z.
const OTHER_AXES: &[u8] = b"ABCDEIJKUV";

/// G28. W (no levelling afterwards) has no effect, as there is no levelling.
fn home<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    words.needless(b'W');
    let axes = AxisFlags { x: words.has(b'X'), y: words.has(b'Y'), z: words.has(b'Z'), e: false };
    if axes.is_empty() && OTHER_AXES.iter().any(|&axis| words.is_present(axis)) {
        return Ok(Command::Accepted);
    }
    Ok(Command::Home { axes, unless_homed: words.flag(b'O') })
}

/// G92. Without words all become zero; so does an axis without a number, for which the
/// line was written.
fn set_position<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.places(words)?;
    if words.is_empty() {
        let zero = Some(Decimal::ZERO);
        return Ok(Command::SetPosition(AxisWords { x: zero, y: zero, z: zero, e: zero }));
    }
    let [x, y, z, e] = b"XYZE".map(|axis| words.value_or_zero(axis));
    Ok(Command::SetPosition(AxisWords { x, y, z, e }))
}

/// G10 and G11. On other machines they set a tool's temperatures with P or R, and its offset with L
/// or with P and an axis.
fn retract_or_recover<'a>(
    code: Code<'a>,
    command: Command<'a>,
    words: &mut Words<'_>,
) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    let [p, r, l] = b"PRL".map(|letter| words.has(letter));
    let names_tool = p || r;
    let moves_tool = names_tool && b"XYZ".iter().any(|&axis| words.is_not_zero(axis));
    if l || moves_tool {
        return Err(not_supported("G10 with an offset", "the part would lie elsewhere; use G92"));
    }
    if names_tool {
        words.forgive();
        return Ok(code.unknown());
    }
    Ok(command)
}
