//! Frames: their marks, lengths and checksums.

use super::read::Decoder;
use crate::checksum::checksum;
use crate::error::{Fault, ReadError};

/// Bytes with which a frame begins: not text, and unlikely as a number.
pub const MARK: [u8; 2] = [0xa7, 0x5d];

/// Bytes before the payload.
pub const HEAD_BYTES: usize = 8;

/// Bytes of the checksum after it.
pub const CRC_BYTES: usize = 4;

/// The longest payload.
pub const MAX_PAYLOAD_BYTES: usize = 2048 - HEAD_BYTES - CRC_BYTES;

/// Longest frame: the buffer that a reader needs.
pub const MAX_FRAME_BYTES: usize = HEAD_BYTES + MAX_PAYLOAD_BYTES + CRC_BYTES;

/// The length of a whole frame by its first [`HEAD_BYTES`].
///
/// # Errors
/// No frame begins here, or the frame is too long.
pub fn frame_length(head: &[u8; HEAD_BYTES]) -> Result<usize, Fault> {
    let [mark_0, mark_1, low, high, ..] = *head;
    if [mark_0, mark_1] != MARK {
        return Err(Fault::NoFrame);
    }
    let length = usize::from(u16::from_le_bytes([low, high]));
    if length > MAX_PAYLOAD_BYTES {
        return Err(Fault::Length { length: length as u32 });
    }
    Ok(HEAD_BYTES + length + CRC_BYTES)
}

/// A whole frame whose checksum is right.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Number of the frame.
    pub number: u32,
    /// Content of the frame.
    payload: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Checks the bytes of one frame, as many as [`frame_length`] gives, which begin at `offset` in
    /// the file.
    ///
    /// # Errors
    /// Too few or too many bytes, a number other than `expected` (if given), changed bits.
    pub fn read(bytes: &'a [u8], offset: u64, expected: Option<u32>) -> Result<Self, ReadError> {
        let fail = |fault| ReadError { fault, offset, frame: expected };
        let head = bytes.first_chunk::<HEAD_BYTES>().ok_or(fail(Fault::Truncated))?;
        let length = frame_length(head).map_err(fail)?;
        let (before, rest) = bytes.split_at_checked(length - CRC_BYTES).ok_or(fail(Fault::Truncated))?;
        let sum = rest.first_chunk::<CRC_BYTES>().ok_or(fail(Fault::Truncated))?;
        if rest.len() > CRC_BYTES {
            return Err(fail(Fault::Trailing));
        }
        let (file, computed) = (u32::from_le_bytes(*sum), checksum(before));
        if file != computed {
            return Err(fail(Fault::Checksum { file, computed }));
        }
        let [.., a, b, c, d] = *head;
        let number = u32::from_le_bytes([a, b, c, d]);
        if let Some(expected) = expected
            && number != expected
        {
            return Err(fail(Fault::Sequence { number, expected }));
        }
        Ok(Self { number, payload: before.get(HEAD_BYTES..).unwrap_or(&[]) })
    }

    /// Starts reading the frame's items.
    ///
    /// # Errors
    /// The content is invalid.
    pub fn items(&self) -> Result<Decoder<'a>, Fault> {
        Decoder::new(self.payload)
    }
}
