//! The bytes of lines on their way to a printer.

use ferrostep_gcode::meatpack;

/// The form in which lines of G-code go to the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// Text.
    Plain,
    /// MeatPack: two characters in a byte.
    MeatPack,
}

impl Packing {
    /// The bytes of a line.
    pub(super) fn bytes(self, line: &str) -> Vec<u8> {
        match self {
            Self::Plain => line.as_bytes().to_vec(),
            Self::MeatPack => {
                let mut bytes = Vec::with_capacity(line.len());
                meatpack::pack(line, |byte| bytes.push(byte));
                bytes
            }
        }
    }
}
