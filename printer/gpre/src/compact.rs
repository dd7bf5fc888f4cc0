//! The compact encoding: frames of bits.
//!
//! A frame is self-contained: it holds the machine's position at its start and the settings in
//! force, so a job can be entered at any frame marked as an entry.
//!
//! | byte | type | meaning |
//! |---|---|---|
//! | 0 | u16 | mark, [`MARK`] |
//! | 2 | u16 | length of the payload, bytes |
//! | 4 | u32 | number of the frame, from 0 |
//! | 8 | bits | payload |
//! | 8 + length | u32 | CRC-32 of all before it |
//!
//! Bytes little-endian, bits the most significant first. g(k) is an exponential Golomb code of
//! order k, s(k) one of a number with a sign. The payload:
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
//! | 4 x 5 | orders of the codes of X, Y, Z and of the filament's difference from its prediction |
//! | g(8) | number of items |
//!
//! An item is `0` and a move of the same shape as the move before, `10` and a move with its shape
//! before it, or `11` and one of eight others in three bits.
//!
//! *Shape*, 7 bits: what is encoded of the path (2: X and Y, X Y and Z, Z, nothing), of the
//! filament (2: nothing, its difference from the prediction, all of it), whether the source line is
//! the same as before (1) instead of the next, whether the line's move ends (1), whether the
//! filament counts in E (1). The shape before the first is `Shape::FIRST`.
//!
//! *Move*: its planned speed: `0` = what corner and feeds allow, `10` = what is left of the speed
//! before, `110` = it continues the block, `111` = 6 bits n and the squared speed plus one in n + 1
//! bits, of which the first, a one, is left out. Then what the shape says: steps of X, Y, Z in
//! their unit, s(k) each. Then the filament in its unit: the difference from lambda times the
//! length of the path, s(k), or all of it, s(12). The prediction is worked out in f32: the root of
//! x x + y y + z z, in steps, times lambda, cut to a whole number.
//!
//! *Others*: 0 = the feed at a place (3 bits) of the eight encoded last, 1 = a feed (f32), 2 = the
//! lambda at a place (3), 3 = a lambda (the upper 24 bits of an f32), 4 = source lines are left out
//! (g(2), and one), 5 = the fan (8), after the lines left out, g(1); 6 = a command after the lines
//! left out, g(1): 2 bits and 0 = a text (its length, 8, and its bytes), 1 = the command at a place
//! (3) of the eight encoded last, 2 = a command of letters and whole numbers: which of G, M and T
//! (2), its number g(6), number of words (3), and of each word its letter (5), whether it has a
//! number (1), the number s(5). New feeds, lambdas and commands take the places in turn.

mod frame;
mod read;
mod shape;
#[cfg(feature = "write")]
mod write;

pub use frame::{CRC_BYTES, Frame, HEAD_BYTES, MARK, MAX_FRAME_BYTES, MAX_PAYLOAD_BYTES, frame_length};
pub use read::{Decoder, FrameState};
pub use shape::MAX_TEXT_BYTES;
#[cfg(feature = "write")]
pub use write::FrameWriter;
