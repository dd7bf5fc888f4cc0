//! Encodes lines on their way to a printer.

use ferrostep_gcode::meatpack;

/// Encoding in which lines of G-code go to the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// Plain text.
    Plain,
    /// MeatPack: two characters per byte.
    MeatPack,
}

impl Packing {
    /// Encodes a line.
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
