//! M955 and M956, as RepRapFirmware has them: an accelerometer and its records.

use super::code::Code;
use super::words::Words;
use crate::{Command, ParseError};

/// Reads the words of M955 (and else of M956). There is one accelerometer, 0, whose pins
/// are the board's.
pub(super) fn parse<'a>(code: Code<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
    let is_of_settings = code.number == 955;
    if code.rest.contains('"') {
        return Err(if is_of_settings {
            ParseError::NotSupported { command: "M955 with C", why: "the pins are the board's; leave C out" }
        } else {
            ParseError::NotSupported { command: "M956 with F", why: "records go to the host; leave F out" }
        });
    }
    let words = code.words(words)?;
    words.whole_to(b'P', 0)?;
    if is_of_settings {
        let (rate_hz, resolution_bits) = (words.whole_up_to(b'S', u16::MAX)?, words.whole_to(b'R', u8::MAX)?);
        return Ok(Command::Accelerometer { rate_hz, resolution_bits });
    }
    let axes = [words.has(b'X'), words.has(b'Y'), words.has(b'Z')];
    if axes.contains(&true) && axes.contains(&false) {
        let why = "a record has X, Y and Z; name all of them or none";
        return Err(ParseError::NotSupported { command: "M956 of some axes", why });
    }
    let Some(samples) = words.whole_up_to(b'S', u16::MAX)? else {
        return Err(ParseError::WordsExpected { command: "M956", words: "S with the number of samples" });
    };
    let at_next_move = words.switch(b'A')? == Some(true);
    Ok(Command::RecordAcceleration { samples, at_next_move })
}

#[cfg(test)]
mod tests {
    use super::super::tests::{reads, reads_with, refused};
    use super::*;

    #[test]
    fn an_accelerometer_and_its_records() {
        let settings = |rate_hz, resolution_bits| Command::Accelerometer { rate_hz, resolution_bits };
        reads("M955", settings(None, None));
        reads("M955 P0", settings(None, None));
        reads("M955 P0 S1600 R12", settings(Some(1600), Some(12)));
        reads_with("M955 P0 I20", settings(None, None), "I has no effect");
        let record = |samples, at_next_move| Command::RecordAcceleration { samples, at_next_move };
        reads("M956 P0 S1000", record(1000, false));
        reads("M956 S65535 A1 X Y Z", record(65535, true));
        reads("M956 P0 S0 A0", record(0, false));
    }

    #[test]
    fn what_is_not_there_is_refused_by_its_name() {
        for (text, says) in [
            ("M955 P1", "P: 1 is out of range"),
            ("M955 S-1", "S: -1 is out of range"),
            ("M955 P0 C\"spi.cs1+spi.cs0\"", "M955 with C: not supported, the pins are the board's; leave C out"),
            ("M956", "M956: expected S with the number of samples"),
            ("M956 S65536", "S: 65536 is out of range, expected 0 to 65535"),
            ("M956 S100 A2", "A: 2 is out of range, expected 0 to 1"),
            ("M956 S100 X", "M956 of some axes: not supported, a record has X, Y and Z; name all of them or none"),
            ("M956 S100 F\"x.csv\"", "M956 with F: not supported, records go to the host; leave F out"),
        ] {
            assert!(refused(text).starts_with(says), "{text}: {}", refused(text));
        }
    }
}
