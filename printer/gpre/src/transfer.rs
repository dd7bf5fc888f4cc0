//! A prepared job over a serial line on which bytes are lost and changed.
//!
//! The host sends the file in *frames*; the board answers in lines. A frame names the place of
//! its bytes in the file, so a repeated one does no harm and a missing one is noticed by the
//! next. The board says up to where it has everything and how far the host may send: nothing is
//! sent that has no room.
//!
//! A frame is a line of bytes. It begins with [`FLAG`] where a line begins and ends with
//! `\n`; between them:
//!
//! | byte | type | meaning |
//! |---|---|---|
//! | 0 | u8 | kind: 1 = data, 2 = question, 3 = abort |
//! | 1 | u32 | data: place of the first byte in the file; question: the next byte that the host would send; abort: 0 |
//! | 5 | u8 | number of bytes that follow, of data |
//! | 6 | bytes | the data |
//! | 6 + n | u32 | CRC-32 of all before it |
//!
//! Little-endian. The bytes 0A, 0D, 11, 13, 4D (`M`), 6D (`m`), 7D, 7E and FF are sent as
//! [`ESCAPE`] and the byte with its highest bit turned over. So a frame has no line end, no `M` and
//! no flow control in it: what acts as its bytes arrive (M112, M108, M410) cannot be in a frame,
//! and is noticed between any two. A frame must have two or more of its bytes changed, to a line
//! end and an `M`, before something of it could be taken for such a command; a line that begins
//! with the rest of a broken frame begins with no letter.
//!
//! The board's lines are [`Report`]s: `gpre:`, a word, two numbers, a star and the CRC-32 of
//! what is before the star's blank, in eight hexadecimal digits. Other lines from it are what
//! they always are.

mod frame;
mod receive;
mod report;
#[cfg(feature = "write")]
mod send;
mod stray;
mod wire;

pub use frame::{ESCAPE, FLAG, Kind, MAX_DATA_BYTES};
pub use receive::{Event, Receiver};
pub use report::{Report, Word};
#[cfg(feature = "write")]
pub use send::{Sender, without_thumbnail};
pub use stray::{StrayFrames, Stretch};
#[cfg(feature = "write")]
pub use wire::to_wire;
