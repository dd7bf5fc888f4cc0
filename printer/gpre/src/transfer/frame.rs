//! The parts of a frame.

/// The byte with which a frame begins.
pub const FLAG: u8 = 0x7e;

/// The byte after which the next one's highest bit is inverted.
pub const ESCAPE: u8 = 0x7d;

/// The maximum number of data bytes in a frame.
pub const MAX_DATA_BYTES: usize = 255;

/// Bytes before the data.
pub(super) const HEAD_BYTES: usize = 6;

/// Bytes of the checksum.
pub(super) const CRC_BYTES: usize = 4;

/// The purpose of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Bytes of the file.
    Data,
    /// The host wants to know what the board has.
    Question,
    /// The host gives up.
    Abort,
}

impl Kind {
    pub(super) const ALL: [Self; 3] = [Self::Data, Self::Question, Self::Abort];

    /// Number of the word in a frame.
    pub(super) const fn number(self) -> u8 {
        self as u8 + 1
    }
}
