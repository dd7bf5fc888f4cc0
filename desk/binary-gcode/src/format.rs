//! Headers, as they are in the file; little-endian.

use crate::block_kind::{BlockKind, ThumbnailFormat};
use crate::error::Reason;

/// The first bytes of every file.
pub const MAGIC: [u8; 4] = *b"GCDE";

/// The version that this reader knows.
const VERSION: u32 = 1;

/// Bytes of the file's header: the magic number, the version, the kind of checksum.
pub(crate) const FILE_HEADER_BYTES: usize = 10;

/// Bytes of a block's header before the size of its compressed contents.
pub(crate) const PLAIN_HEADER_BYTES: usize = 8;

/// Bytes of a block's header with compression.
const COMPRESSED_HEADER_BYTES: usize = 12;

/// Bytes of a block's checksum.
pub(crate) const CRC_BYTES: usize = 4;

/// The most bytes before a block's data: its header and a thumbnail's parameters.
pub(crate) const MAX_HEAD_BYTES: usize = COMPRESSED_HEADER_BYTES + 6;

/// Compression of a block's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compression {
    None,
    Deflate,
    /// Heatshrink with a window of 2 to the power of these bits, and a look-ahead of 4 bits.
    Heatshrink(u8),
}

#[cfg(feature = "write")]
impl Compression {
    /// The number in a block's header.
    pub const fn number(self) -> u16 {
        match self {
            Self::None => 0,
            Self::Deflate => 1,
            Self::Heatshrink(11) => 2,
            Self::Heatshrink(_) => 3,
        }
    }
}

/// The number of a kind in a block's header.
#[cfg(feature = "write")]
pub(crate) const fn kind_number(kind: BlockKind) -> u16 {
    match kind {
        BlockKind::FileMetadata => 0,
        BlockKind::Gcode => 1,
        BlockKind::SlicerMetadata => 2,
        BlockKind::PrinterMetadata => 3,
        BlockKind::PrintMetadata => 4,
        BlockKind::Thumbnail { .. } => 5,
    }
}

/// A file's header; whether its blocks have checksums.
pub(crate) fn file_header(bytes: &[u8]) -> Result<bool, Reason> {
    if !bytes.starts_with(&MAGIC) {
        return Err(Reason::NotBinaryGcode);
    }
    match u32_at(bytes, 4) {
        VERSION => {}
        version => return Err(Reason::Version(version)),
    }
    match u16_at(bytes, 8) {
        0 => Ok(false),
        1 => Ok(true),
        kind => Err(Reason::ChecksumKind(kind)),
    }
}

/// A block's header with its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Head {
    pub kind: BlockKind,
    pub compression: Compression,
    /// Bytes of its data in the file.
    pub stored_bytes: u32,
    /// Bytes of its data, decompressed.
    pub bytes: u32,
    /// First parameter: the encoding of the data.
    pub encoding: u16,
}

impl Head {
    /// Bytes that a block's header and parameters take, by its first [`PLAIN_HEADER_BYTES`].
    pub fn length(bytes: &[u8]) -> Result<usize, Reason> {
        let header = match compression(bytes)? {
            Compression::None => PLAIN_HEADER_BYTES,
            Compression::Deflate | Compression::Heatshrink(_) => COMPRESSED_HEADER_BYTES,
        };
        match u16_at(bytes, 0) {
            0..=4 => Ok(header + 2),
            5 => Ok(header + 6),
            number => Err(Reason::Kind(number)),
        }
    }

    /// A header with its parameters, whole.
    pub fn of(bytes: &[u8]) -> Result<Self, Reason> {
        let compression = compression(bytes)?;
        let (header, stored) = match compression {
            Compression::None => (PLAIN_HEADER_BYTES, 4),
            Compression::Deflate | Compression::Heatshrink(_) => (COMPRESSED_HEADER_BYTES, 8),
        };
        let encoding = u16_at(bytes, header);
        let kind = match u16_at(bytes, 0) {
            0 => BlockKind::FileMetadata,
            1 => BlockKind::Gcode,
            2 => BlockKind::SlicerMetadata,
            3 => BlockKind::PrinterMetadata,
            4 => BlockKind::PrintMetadata,
            5 => BlockKind::Thumbnail {
                format: thumbnail_format(encoding)?,
                width: u16_at(bytes, header + 2),
                height: u16_at(bytes, header + 4),
            },
            number => return Err(Reason::Kind(number)),
        };
        Ok(Self { kind, compression, stored_bytes: u32_at(bytes, stored), bytes: u32_at(bytes, 4), encoding })
    }
}

fn compression(bytes: &[u8]) -> Result<Compression, Reason> {
    match u16_at(bytes, 2) {
        0 => Ok(Compression::None),
        1 => Ok(Compression::Deflate),
        2 => Ok(Compression::Heatshrink(11)),
        3 => Ok(Compression::Heatshrink(12)),
        number => Err(Reason::Compression(number)),
    }
}

fn thumbnail_format(number: u16) -> Result<ThumbnailFormat, Reason> {
    match number {
        0 => Ok(ThumbnailFormat::Png),
        1 => Ok(ThumbnailFormat::Jpeg),
        2 => Ok(ThumbnailFormat::Qoi),
        number => Err(Reason::Encoding(number)),
    }
}

/// The number at a place; 0 past the end.
fn u16_at(bytes: &[u8], place: usize) -> u16 {
    bytes.get(place..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u16::from_le_bytes(*bytes))
}

/// The number at a place; 0 past the end.
pub(crate) fn u32_at(bytes: &[u8], place: usize) -> u32 {
    bytes.get(place..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u32::from_le_bytes(*bytes))
}
