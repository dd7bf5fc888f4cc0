//! M569, M906, M913 and M914: the motors' drivers.

use super::code::Code;
use super::words::Words;
use crate::remarks::Remark;
use crate::{Command, DriverSetting, DriverWords, ParseError};

/// M569. With P it is the M569 of another firmware, which sets a driver's direction by its number.
pub(super) fn stealth_chop<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    if words.has(b'P') {
        words.forgive();
        words.remark(Remark::DriverByNumber);
        return Ok(Command::Accepted);
    }
    let (motors, on) = (words.axis_flags(), words.switch(b'S')?);
    if on.is_some() && motors.is_empty() {
        return Err(ParseError::WordsExpected { command: "M569", words: "X, Y, Z or E" });
    }
    Ok(Command::StealthChop { motors, tool: words.tool(b'T'), on })
}

/// M906, M913 and M914.
pub(super) fn setting<'a>(
    setting: DriverSetting,
    code: Code<'a>,
    words: &mut Words<'_>,
) -> Result<Command<'a>, ParseError> {
    let words = code.words(words)?;
    let tool = words.tool(b'T');
    let mut number = |letter| words.whole_up_to(letter, setting.max());
    let [x, y, z, e] = [number(b'X')?, number(b'Y')?, number(b'Z')?, number(b'E')?];
    Ok(Command::Driver(setting, DriverWords { x, y, z, e, tool }))
}
