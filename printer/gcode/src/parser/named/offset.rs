//! SET_GCODE_OFFSET, as Klipper has it, of Z.

use super::NamedWords;
use crate::{Command, Decimal, ParseError};

/// The keys of its words.
pub(super) const WORDS: &str = "X, Y, Z, E, X_ADJUST, Y_ADJUST, Z_ADJUST, E_ADJUST, MOVE";
/// Form of its words, for errors.
pub(super) const FORM: &str = "Z or Z_ADJUST with a number, and MOVE with 0 or 1";

/// Reads the command's words. Z is the offset, Z_ADJUST is added to it; offsets of X, Y and
/// E can be 0 only.
pub(super) fn parse<'a>(words: &NamedWords<'a>) -> Result<Command<'a>, ParseError> {
    let mut is_named = false;
    for key in ["X", "Y", "E", "X_ADJUST", "Y_ADJUST", "E_ADJUST"] {
        match words.number(key)? {
            None => {}
            Some(Decimal::ZERO) => is_named = true,
            Some(_) => {
                return Err(ParseError::NotSupported {
                    command: "SET_GCODE_OFFSET of X, Y and E",
                    why: "the part would lie elsewhere; use G92",
                });
            }
        }
    }
    let (z, by, moves) = (words.number("Z")?, words.number("Z_ADJUST")?, words.count("MOVE")?);
    match z.or(by) {
        Some(offset) => Ok(Command::OffsetZ { offset, adds: z.is_none(), moves: moves.is_some_and(|moves| moves > 0) }),
        None if is_named => Ok(Command::Accepted),
        None => Err(words.expected()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::tests::{number, reads, reads_with, refused};
    use super::*;

    #[test]
    fn offsets_of_z_are_read() {
        let offset = |offset, adds, moves| Command::OffsetZ { offset: number(offset), adds, moves };
        reads("SET_GCODE_OFFSET Z=-0.005", offset("-0.005", false, false));
        reads("set_gcode_offset z_adjust=.05 move=1", offset("0.05", true, true));
        reads("SET_GCODE_OFFSET X=0 Y=0.0 Z=0.1 MOVE=0", offset("0.1", false, false));
        reads("SET_GCODE_OFFSET Z=0.1 Z_ADJUST=0.2", offset("0.1", false, false));
        reads_with(
            "SET_GCODE_OFFSET Z=0.1 MOVE=1 MOVE_SPEED=5",
            offset("0.1", false, true),
            "MOVE_SPEED has no effect",
        );
        reads("SET_GCODE_OFFSET X=0 E=0", Command::Accepted);
    }

    #[test]
    fn other_axes_and_missing_words_are_refused() {
        for words in ["X=1", "Y_ADJUST=-0.1", "Z=0.1 X=2", "E=1"] {
            let text = refused(&format!("SET_GCODE_OFFSET {words}"));
            assert_eq!(text, "SET_GCODE_OFFSET of X, Y and E: not supported, the part would lie elsewhere; use G92");
        }
        for words in ["", "MOVE=1", "Z=up", "Z=", "Z_ADJUST=0.1 MOVE=-1"] {
            let text = refused(&format!("SET_GCODE_OFFSET {words}"));
            assert_eq!(text, format!("SET_GCODE_OFFSET: expected {FORM}"), "{words}");
        }
        let text = refused("SET_GCODE_OFFSET ZZ=0.1");
        assert_eq!(text, format!("SET_GCODE_OFFSET: unknown word \"ZZ\", expected {FORM}"));
    }
}
