//! Motion and geometry.

use super::Code;
use super::words::{Words, skip_blanks};
use crate::remarks::{Remark, Remarks};
use crate::{ArcForm, AxisWords, Command, Decimal, ParseError, Units};

pub(super) fn parse<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    if code.has_subcode {
        return match code.number {
            // G29.1 and the like belong to bed levelling, as G29 itself.
            29 => Ok(Command::Accepted),
            0..=6 => Err(not_supported("G0.x to G6.x", "the move would be missing; use G0 to G3")),
            38 => Err(PROBING),
            92 => Err(not_supported("G92.x", "the coordinates would stay as they are; use G92 with X, Y, Z or E")),
            53..=59 => Err(WORKSPACE),
            _ => Ok(code.unknown()),
        };
    }
    match code.number {
        0 | 1 => {
            let mut words = Words::new(remarks);
            words.read(code.rest)?;
            Ok(Command::Linear { rapid: code.number == 0, axes: words.axes(), feed: words.above_zero(b'F') })
        }
        2 => arc(code, true, remarks),
        3 => arc(code, false, remarks),
        4 => dwell(code, remarks),
        10 => retract_or_recover(code, Command::Retract, remarks),
        11 => retract_or_recover(code, Command::Recover, remarks),
        18 | 19 => Err(ParseError::PlaneNotSupported),
        20 => code.without_words(Command::SetUnits(Units::Inches), remarks),
        21 => code.without_words(Command::SetUnits(Units::Millimetres), remarks),
        28 => Ok(Command::Home(code.words(remarks)?.axis_flags())),
        // Bed levelling: start scripts contain it whether or not the machine has it.
        29 => Ok(Command::Accepted),
        17 | 54 | 80 => code.without_words(Command::Accepted, remarks),
        // Before a move G53 means machine coordinates, and the move must not vanish silently.
        53 if skip_blanks(code.rest.as_bytes(), 0) == code.rest.len() => Ok(Command::Accepted),
        90 => code.without_words(Command::AbsolutePositioning, remarks),
        91 => code.without_words(Command::RelativePositioning, remarks),
        92 => set_position(code, remarks),
        _ => displacing(code, remarks),
    }
}

/// Unknown commands, some of which must not be skipped: the rest of the job would be printed elsewhere or with other feeds.
fn displacing<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    Err(match code.number {
        5 => not_supported("G5", "the curve would be missing; let the slicer write G1, G2 or G3"),
        6 => not_supported("G6", "the steps would be missing; use G1"),
        16 => not_supported("G16", "polar coordinates would be read as X and Y; write X and Y"),
        38 => PROBING,
        41 | 42 => not_supported("G41 and G42", "the path would lie elsewhere; let the slicer correct it"),
        43 | 44 => not_supported("G43 and G44", "Z would be off by the tool's length; leave the offset out"),
        51 => not_supported("G51", "the part would have another size; scale it in the slicer"),
        52 => not_supported("G52", "the part would lie elsewhere; use G92"),
        53 => not_supported("G53 with a move", "the move would be missing; put the move on a line of its own"),
        55..=59 => WORKSPACE,
        68 => not_supported("G68", "the part would lie elsewhere; turn it in the slicer"),
        73 | 76 | 81..=89 if code.words(remarks)?.axes() != AxisWords::default() => {
            not_supported("G73 to G89", "the moves of the cycle would be missing; write G0 and G1")
        }
        93 => not_supported("G93", "every feed would be wrong; write feeds per minute (G94)"),
        95 => not_supported("G95", "every feed would be wrong; write feeds per minute (G94)"),
        _ => return Ok(code.unknown()),
    })
}

const PROBING: ParseError = not_supported("G38", "the nozzle would not stand at the probed place; home with G28");

const WORKSPACE: ParseError =
    not_supported("G55 to G59", "the part would lie elsewhere; use the coordinates of G54, or G92");

const fn not_supported(command: &'static str, why: &'static str) -> ParseError {
    ParseError::NotSupported { command, why }
}

fn arc<'a>(code: Code<'a>, clockwise: bool, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    // P means more full circles, K an arc in another plane.
    if words.is_not_zero(b'P') || words.is_not_zero(b'K') {
        return Err(not_supported("G2 and G3 with P or K", "the arc would be missing; write arcs in XY, once around"));
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

fn dwell<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    let from_milliseconds = words.nearest(b'P', 1)?;
    let from_seconds = words.nearest(b'S', 1000)?;
    let milliseconds = from_seconds.or(from_milliseconds).unwrap_or_else(|| {
        words.remark(Remark::BareDwell);
        0
    });
    Ok(Command::Dwell { milliseconds })
}

/// G92. If no axis is named all become zero; an axis without a number stays.
fn set_position<'a>(code: Code<'a>, remarks: &mut Remarks) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    if words.axis_flags().is_empty() {
        let zero = Some(Decimal::ZERO);
        return Ok(Command::SetPosition(AxisWords { x: zero, y: zero, z: zero, e: zero }));
    }
    Ok(Command::SetPosition(words.axes()))
}

/// G10 and G11. On other machines they set a tool's temperatures with P or R, and its offset with L or with P and an axis.
fn retract_or_recover<'a>(
    code: Code<'a>,
    command: Command<'a>,
    remarks: &mut Remarks,
) -> Result<Command<'a>, ParseError> {
    let mut words = code.words(remarks)?;
    let names_tool = words.has(b'P') || words.has(b'R');
    let moves_tool = names_tool && b"XYZ".iter().any(|&axis| words.is_not_zero(axis));
    if words.has(b'L') || moves_tool {
        return Err(not_supported("G10 with an offset", "the part would lie elsewhere; use G92"));
    }
    Ok(if names_tool { code.unknown() } else { command })
}
