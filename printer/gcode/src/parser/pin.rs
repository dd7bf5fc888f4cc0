//! M280, M401, M402 and BLTOUCH_DEBUG: the pin of a probe.

use super::code::Code;
use super::named::NamedWords;
use super::words::Words;
use crate::not_executed::is_one_of;
use crate::remarks::Remark;
use crate::{Command, ParseError, PinCommand};

/// The words of BLTOUCH_DEBUG.
pub(super) const DEBUG_WORDS: &str = "COMMAND=pin_down, pin_up, touch_mode, self_test or reset";

/// Named commands of the probe, with their pulse widths.
static WIDTHS_US: [(&str, u16); 5] = [
    ("pin_down", PinCommand::OUT_US),
    ("pin_up", PinCommand::IN_US),
    ("touch_mode", PinCommand::TOUCH_MODE_US),
    ("self_test", PinCommand::SELF_TEST_US),
    ("reset", PinCommand::RELEASE_US),
];

#[inline(never)]
pub(super) fn m_code<'a>(code: &Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    match code.number {
        401 => return code.without_words(Command::ProbePin(PinCommand::Out), words),
        402 => return code.without_words(Command::ProbePin(PinCommand::In), words),
        _ => {}
    }
    let words = code.words(words)?;
    if words.is_other_than(b'P', 0) {
        words.remark(Remark::NoServo);
        return Ok(Command::Accepted);
    }
    let [least, most] = PinCommand::ANGLES_US;
    let Some(mut width_us) = words.whole_up_to(b'S', most)? else {
        words.remark(Remark::WithoutS);
        return Ok(Command::Accepted);
    };
    // Below, it is an angle.
    if width_us < least
        && let Some(degrees) = words.whole_up_to(b'S', 180)?
    {
        width_us = PinCommand::at_angle_us(degrees);
    }
    Ok(Command::ProbePin(PinCommand::Pulses { width_us }))
}

/// BLTOUCH_DEBUG.
#[inline(never)]
pub(super) fn debug<'a>(words: &NamedWords<'_>) -> Result<Command<'a>, ParseError> {
    let asked = words.value("COMMAND").unwrap_or_default();
    let found = WIDTHS_US.iter().find(|(name, _)| is_one_of(name.as_bytes(), asked));
    let &(_, width_us) = found.ok_or(words.expected())?;
    Ok(Command::ProbePin(PinCommand::Pulses { width_us }))
}
