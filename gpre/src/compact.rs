//! The compact encoding: frames of bits.
//!
//! A frame stands for itself: where the machine is at its start and the settings in force are in it, so a job can
//! be entered at any frame that says so.
//!
//! | byte | type | meaning |
//! |---|---|---|
//! | 0 | u16 | mark, [`MARK`] |
//! | 2 | u16 | length of the payload, bytes |
//! | 4 | u32 | number of the frame, from 0 |
//! | 8 | bits | payload |
//! | 8 + length | u32 | CRC-32 of all before it |
//!
//! Bytes little-endian, bits the most significant first. g(k) is an exponential Golomb code of order k, s(k) one of a number
//! with a sign. The payload:
//!
//! | bits | meaning |
//! |---|---|
//! | 1 | the frame can be entered: it begins with a new block |
//! | 3 s(24) | X, Y and Z at its start, units of 10 nm |
//! | g(20) | number of the source line before its first |
//! | 32 | feed, mm/s, f32 |
//! | s(28), 3 s(8), s(8) | E of the G-code, what G92 has added to X, Y and Z, and how far Z is lifted, units of 10 nm |
//! | g(8) g(8) | targets of nozzle and bed, degrees Celsius |
//! | g(7) g(7) | feed and flow, percent |
//! | 8 | fan |
//! | 1, 16 values | whether limits are there that are not the profile's; each g(10) after 0, or an f32 after 1 |
//! | g(7) | unit of X, Y and Z, of 10 nm |
//! | g(7) | unit of the filament, of 0.1 nm |
//! | 4 x 5 | orders of the codes of X, Y, Z and of what the filament differs from its prediction |
//! | g(8) | number of items |
//!
//! An item is `0` and a move of the same shape as the move before, `10` and a move with its shape before it, or `11` and one
//! of eight others in three bits.
//!
//! *Shape*, 7 bits: what is encoded of the path (2: X and Y, X Y and Z, Z, nothing), of the filament (2: nothing, its difference
//! from the prediction, all of it), whether the source line is the same as before (1) instead of the next, whether the
//! line's move ends (1), whether the filament counts in E (1). The shape before the first is `Shape::FIRST`.
//!
//! *Move*: its planned speed: `0` = what corner and feeds allow, `10` = what is left of the speed before, `110` = it continues
//! the block, `111` = 6 bits n and the squared speed plus one in n + 1 bits, of which the first, a one, is left out. Then
//! what the shape says: steps of X, Y, Z in their unit, s(k) each. Then the filament in its unit: the difference from
//! lambda times the length of the path, s(k), or all of it, s(12). The prediction is worked out in f32:
//! the root of x x + y y + z z, in steps, times lambda, cut to a whole number.
//!
//! *Others*: 0 = the feed at a place (3 bits) of the eight encoded last, 1 = a feed (f32), 2 = the lambda at a
//! place (3), 3 = a lambda (the upper 24 bits of an f32), 4 = source lines are left out (g(2), and one), 5 = the fan (8),
//! after the lines left out, g(1); 6 = a command after the lines left out, g(1): 2 bits and 0 = a text (its length, 8, and its bytes),
//! 1 = the command at a place (3) of the eight encoded last, 2 = a command of letters and whole numbers: which of G, M and T (2),
//! its number g(6), number of words (3), and of each word its letter (5), whether it has a number (1), the number s(5).
//! New feeds, lambdas and commands take the places in turn.

mod read;
#[cfg(feature = "write")]
mod write;

pub use read::{Decoder, FrameState};
#[cfg(feature = "write")]
pub use write::FrameWriter;

use crate::checksum;
use crate::error::{Fault, ReadError};

/// The bytes with which a frame begins: no text, and no likely number.
pub const MARK: [u8; 2] = [0xa7, 0x5d];

/// Bytes before the payload.
pub const HEAD_BYTES: usize = 8;

/// Bytes of the checksum after it.
pub const CRC_BYTES: usize = 4;

/// The longest payload.
pub const MAX_PAYLOAD_BYTES: usize = 2048 - HEAD_BYTES - CRC_BYTES;

/// The longest frame: what a reader must have room for.
pub const MAX_FRAME_BYTES: usize = HEAD_BYTES + MAX_PAYLOAD_BYTES + CRC_BYTES;

/// Places for feeds, lambdas and commands.
const PLACES: usize = 8;

/// Longest text of a command.
pub const MAX_TEXT_BYTES: usize = 255;

/// What is encoded of a move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shape(u8);

/// What is encoded of the path.
const WAY_XY: u8 = 0;
const WAY_XYZ: u8 = 1;
const WAY_Z: u8 = 2;
#[cfg(feature = "write")]
const WAY_NONE: u8 = 3;

/// What is encoded of the filament.
const FILAMENT_NONE: u8 = 0;
const FILAMENT_PREDICTED: u8 = 1;
const FILAMENT_ALL: u8 = 2;

impl Shape {
    /// Along X and Y with predicted filament, a source line each.
    const FIRST: Self = Self(WAY_XY << 5 | FILAMENT_PREDICTED << 3 | 0b011);
    const BITS: u32 = 7;

    /// Whether a move is encoded by X, Y and the difference of its filament from the prediction.
    #[inline]
    fn is_plain(self) -> bool {
        self.0 >> 3 == WAY_XY << 2 | FILAMENT_PREDICTED
    }

    #[inline]
    fn way(self) -> u8 {
        self.0 >> 5
    }

    #[inline]
    fn filament(self) -> u8 {
        self.0 >> 3 & 3
    }

    #[inline]
    fn same_line(self) -> bool {
        self.0 & 4 != 0
    }

    #[inline]
    fn ends_move(self) -> bool {
        self.0 & 2 != 0
    }

    #[inline]
    fn counts(self) -> bool {
        self.0 & 1 != 0
    }
}

/// Filament that lambda predicts for a path, all in steps of their units.
#[inline(always)]
fn prediction(path: [i32; 3], lambda: f32) -> i32 {
    let [x, y, z] = path.map(|steps| steps as f32);
    (ferrostep_square_root::square_root(x * x + y * y + z * z) * lambda) as i32
}

/// The length of a whole frame by its first [`HEAD_BYTES`].
///
/// # Errors
/// No frame begins here, or one that is too long.
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
    /// Its number.
    pub number: u32,
    /// What is in it.
    payload: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Takes the bytes of one frame, as many as [`frame_length`] says, which begin at `offset` of the file.
    ///
    /// # Errors
    /// Too few or too many bytes, another number than `expected` (if one is), bits that have changed.
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

    /// Begins to read what is in it.
    ///
    /// # Errors
    /// Content that has no meaning.
    pub fn items(&self) -> Result<Decoder<'a>, Fault> {
        Decoder::new(self.payload)
    }
}
