//! The header of a file, in either encoding.
//!
//! | byte | type | meaning |
//! |---|---|---|
//! | 0 | 8 bytes | mark: 89 47 50 52 45 0D 0A 1A (a byte no text has, `GPRE`, and what a transfer as text would change) |
//! | 8 | u16 | version of the format |
//! | 10 | u8 | encoding: 1 = compact, 2 = wide |
//! | 11 | u8 | 0 |
//! | 12 | u32 | length of the header, thumbnail and checksum included |
//! | 16 | u64 | hash of the profile |
//! | 24 | u32 | version of the planner |
//! | 28 | u32 | number of frames (compact) or packets (wide) |
//! | 32 | u64 | moves: G0 to G3 that displace something |
//! | 40 | u64 | estimated time in motion, ms |
//! | 48 | i64 | filament, units of 0.1 nm |
//! | 56 | u32 | layers |
//! | 60 | u8 | thumbnail: 0 = none, 1 = PNG, 2 = JPEG, 3 = QOI |
//! | 61 | u8 | 0 |
//! | 62 | u16 | its width |
//! | 64 | u16 | its height |
//! | 66 | u16 | 0 |
//! | 68 | bytes | the thumbnail |
//! | length - 4 | u32 | CRC-32 of all before it |
//!
//! Little-endian throughout.

use crate::checksum::CRC;
use crate::error::{Fault, ReadError};

/// The mark.
pub const MAGIC: [u8; 8] = [0x89, b'G', b'P', b'R', b'E', 0x0d, 0x0a, 0x1a];

/// The newest version of the format.
pub const VERSION: u16 = 1;

/// Bytes before the thumbnail.
pub const FIXED_BYTES: usize = 68;

/// The maximum length of a thumbnail, bytes.
pub const MAX_THUMBNAIL_BYTES: u32 = 1 << 20;

/// Bytes of the checksum.
const CRC_BYTES: usize = 4;

/// One of the two encodings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Frames of bits.
    Compact,
    /// The paper's packets.
    Wide,
}

/// Encoding of a thumbnail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ThumbnailFormat {
    /// PNG.
    Png,
    /// JPEG.
    Jpeg,
    /// QOI.
    Qoi,
}

/// The slicer's picture of the job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Thumbnail {
    /// Format of the thumbnail.
    pub format: ThumbnailFormat,
    /// Width, pixels.
    pub width: u16,
    /// Height, pixels.
    pub height: u16,
    /// Length, bytes.
    pub length: u32,
}

/// The header's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The encoding.
    pub encoding: Encoding,
    /// Hash of the profile that the job was prepared for.
    pub profile_hash: u64,
    /// Version of the planner.
    pub planner_version: u32,
    /// Number of frames, or packets.
    pub frames: u32,
    /// G0 to G3 that displace something.
    pub moves: u64,
    /// Estimated time in motion, ms.
    pub motion_ms: u64,
    /// Net filament, units of 0.1 nm.
    pub filament_100pm: i64,
    /// Number of layers, by the slicer's comments.
    pub layers: u32,
    /// The thumbnail, if the slicer wrote one.
    pub thumbnail: Option<Thumbnail>,
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?))
}

impl Header {
    /// True if a file that begins with these bytes claims to be GPRE.
    pub fn is_gpre(bytes: &[u8]) -> bool {
        bytes.starts_with(&MAGIC)
    }

    /// Reads the first [`FIXED_BYTES`] of a file. The checksum follows the thumbnail; see
    /// [`HeaderCheck`].
    ///
    /// # Errors
    /// Another kind of file, a newer version, an unknown encoding, impossible lengths.
    pub fn read(bytes: &[u8]) -> Result<Self, ReadError> {
        let error = |fault, offset| Err(ReadError { fault, offset, frame: None });
        if !Self::is_gpre(bytes) {
            return error(Fault::Magic, 0);
        }
        match Self::fields(bytes) {
            None => error(Fault::Truncated, bytes.len() as u64),
            Some(Err((fault, offset))) => error(fault, offset),
            Some(Ok(header)) => Ok(header),
        }
    }

    fn fields(bytes: &[u8]) -> Option<Result<Self, (Fault, u64)>> {
        let version = u16_at(bytes, 8)?;
        if version > VERSION {
            return Some(Err((Fault::NewerVersion { version, newest: VERSION }, 8)));
        }
        let encoding = match *bytes.get(10)? {
            1 => Encoding::Compact,
            2 => Encoding::Wide,
            number => return Some(Err((Fault::Encoding { number }, 10))),
        };
        let length = u32_at(bytes, 12)?;
        let kind = *bytes.get(60)?;
        let (width, height) = (u16_at(bytes, 62)?, u16_at(bytes, 64)?);
        u16_at(bytes, 66)?;
        let Some(thumbnail_length) = length
            .checked_sub((FIXED_BYTES + CRC_BYTES) as u32)
            .filter(|length| *length <= MAX_THUMBNAIL_BYTES && (kind != 0 || *length == 0))
        else {
            return Some(Err((Fault::Length { length }, 12)));
        };
        let thumbnail = |format| Some(Thumbnail { format, width, height, length: thumbnail_length });
        let thumbnail = match kind {
            0 => None,
            1 => thumbnail(ThumbnailFormat::Png),
            2 => thumbnail(ThumbnailFormat::Jpeg),
            3 => thumbnail(ThumbnailFormat::Qoi),
            _ => return Some(Err((Fault::Content("a thumbnail of a kind from 0 to 3"), 60))),
        };
        Some(Ok(Self {
            encoding,
            profile_hash: u64_at(bytes, 16)?,
            planner_version: u32_at(bytes, 24)?,
            frames: u32_at(bytes, 28)?,
            moves: u64_at(bytes, 32)?,
            motion_ms: u64_at(bytes, 40)?,
            filament_100pm: u64_at(bytes, 48)?.cast_signed(),
            layers: u32_at(bytes, 56)?,
            thumbnail,
        }))
    }

    /// Length of the whole header: the first frame begins there.
    pub fn length(&self) -> u32 {
        (FIXED_BYTES + CRC_BYTES) as u32 + self.thumbnail.map_or(0, |thumbnail| thumbnail.length)
    }

    /// Checks that the job was prepared for this machine by this planner.
    ///
    /// # Errors
    /// It was prepared for another machine, or by another version of the planner.
    pub fn matches(&self, profile_hash: u64, planner_version: u32) -> Result<(), ReadError> {
        let error = |fault, offset| Err(ReadError { fault, offset, frame: None });
        if self.profile_hash != profile_hash {
            return error(Fault::OtherProfile { file: self.profile_hash, machine: profile_hash }, 16);
        }
        if self.planner_version != planner_version {
            return error(Fault::OtherPlanner { file: self.planner_version, machine: planner_version }, 24);
        }
        Ok(())
    }

    /// The bytes of a whole header, with the thumbnail's.
    #[cfg(feature = "write")]
    pub fn to_bytes(&self, thumbnail: &[u8]) -> std::vec::Vec<u8> {
        let mut bytes = std::vec::Vec::with_capacity(FIXED_BYTES + thumbnail.len() + CRC_BYTES);
        let kind = match self.thumbnail.map(|thumbnail| thumbnail.format) {
            None => 0,
            Some(ThumbnailFormat::Png) => 1,
            Some(ThumbnailFormat::Jpeg) => 2,
            Some(ThumbnailFormat::Qoi) => 3,
        };
        let (width, height) = self.thumbnail.map_or((0, 0), |thumbnail| (thumbnail.width, thumbnail.height));
        bytes.extend_from_slice(&MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.push(if self.encoding == Encoding::Compact { 1 } else { 2 });
        bytes.push(0);
        bytes.extend_from_slice(&self.length().to_le_bytes());
        bytes.extend_from_slice(&self.profile_hash.to_le_bytes());
        bytes.extend_from_slice(&self.planner_version.to_le_bytes());
        bytes.extend_from_slice(&self.frames.to_le_bytes());
        bytes.extend_from_slice(&self.moves.to_le_bytes());
        bytes.extend_from_slice(&self.motion_ms.to_le_bytes());
        bytes.extend_from_slice(&self.filament_100pm.to_le_bytes());
        bytes.extend_from_slice(&self.layers.to_le_bytes());
        bytes.extend_from_slice(&[kind, 0]);
        bytes.extend_from_slice(&width.to_le_bytes());
        bytes.extend_from_slice(&height.to_le_bytes());
        bytes.extend_from_slice(&[0, 0]);
        bytes.extend_from_slice(thumbnail);
        let sum = CRC.checksum(&bytes);
        bytes.extend_from_slice(&sum.to_le_bytes());
        bytes
    }
}

/// Checks a header as its bytes pass, however long its thumbnail is.
pub struct HeaderCheck {
    digest: crc::Digest<'static, u32, crc::Table<1>>,
}

impl HeaderCheck {
    /// A check before the header's first byte.
    pub fn new() -> Self {
        Self { digest: CRC.digest() }
    }

    /// Takes bytes of the header, in order: all except the last four.
    pub fn pass(&mut self, bytes: &[u8]) {
        self.digest.update(bytes);
    }

    /// Compares the checksum with the header's last four bytes.
    ///
    /// # Errors
    /// Bits have changed.
    pub fn end(self, last: [u8; CRC_BYTES]) -> Result<(), ReadError> {
        let (file, computed) = (u32::from_le_bytes(last), self.digest.finalize());
        if file == computed {
            return Ok(());
        }
        Err(ReadError { fault: Fault::Checksum { file, computed }, offset: 0, frame: None })
    }
}

impl Default for HeaderCheck {
    fn default() -> Self {
        Self::new()
    }
}
