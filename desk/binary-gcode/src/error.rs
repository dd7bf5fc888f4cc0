//! Errors in a file, and their place.

use core::fmt;

use crate::block_kind::BlockKind;

/// A file cannot be read on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Error {
    /// Number of the block, from 1; 0 for the file's header.
    pub block: u32,
    /// Contents of the block, where known.
    pub kind: Option<BlockKind>,
    /// Offset of the block in the file, bytes.
    pub offset: u64,
    /// The reason.
    pub reason: Reason,
}

/// Reason for which a file is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The file does not begin as binary G-code does.
    NotBinaryGcode,
    /// The version is not 1.
    Version(u32),
    /// The kind of checksum is neither 0 nor 1.
    ChecksumKind(u16),
    /// A block's kind is not one of 0 to 5.
    Kind(u16),
    /// A block's compression is not one of 0 to 3.
    Compression(u16),
    /// A block's contents are encoded in a way that is not known, or a picture's
    /// format is not known.
    Encoding(u16),
    /// A block's checksum is not that of its bytes.
    Checksum {
        /// Checksum in the file.
        stored: u32,
        /// Checksum of the bytes.
        computed: u32,
    },
    /// The file ends within its header or a block.
    Truncated,
    /// This reader was built without Deflate.
    DeflateNotSupported,
    /// The block's compressed bytes are not Deflate's.
    Deflate,
    /// The block's contents have another length than its header says.
    Length {
        /// Length in the header, bytes.
        expected: u32,
    },
    /// The file contains no G-code.
    NoGcode,
}

impl fmt::Display for Error {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { block, kind, offset, reason } = self;
        if *block > 0 {
            write!(formatter, "block {block}")?;
            if let Some(kind) = kind {
                write!(formatter, " ({})", kind.name())?;
            }
            write!(formatter, " at byte {offset}: ")?;
        }
        reason.fmt(formatter)
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotBinaryGcode => formatter.write_str("not binary G-code: the file does not begin with GCDE"),
            Self::Version(version) => {
                write!(formatter, "binary G-code of version {version}, expected version 1: export the file as text")
            }
            Self::ChecksumKind(kind) => {
                write!(formatter, "checksums of kind {kind}, expected 0 (none) or 1 (CRC-32): export the file again")
            }
            Self::Kind(kind) => write!(formatter, "a block of kind {kind}, expected 0 to 5: export the file as text"),
            Self::Compression(number) => {
                write!(formatter, "compression {number}, expected 0 to 3: export the file as text")
            }
            Self::Encoding(number) => {
                write!(formatter, "encoding {number} is not known here: export the file as text")
            }
            Self::Checksum { stored, computed } => write!(
                formatter,
                "damaged: its checksum is {stored:08x}, that of its bytes {computed:08x}: copy or export the file again"
            ),
            Self::Truncated => formatter.write_str("the file ends before its end: copy or export it again"),
            Self::DeflateNotSupported => formatter.write_str(
                "compressed with Deflate, for which a board has no room: export with heatshrink, as PrusaSlicer does, \
                 or as text",
            ),
            Self::Deflate => formatter.write_str("its compressed bytes are damaged: copy or export the file again"),
            Self::Length { expected } => write!(
                formatter,
                "its contents do not have the {expected} bytes that its header says: copy or export the file again"
            ),
            Self::NoGcode => formatter.write_str("the file contains no G-code: export it again"),
        }
    }
}

impl core::error::Error for Error {}
