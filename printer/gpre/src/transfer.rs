//! A prepared job over a serial line on which bytes are lost and changed.
//!
//! The host sends the file in *frames*; the board answers in lines. A frame names the place of its
//! bytes in the file, so a repeated one does no harm and a missing one is noticed by the next. The
//! board reports up to where it has everything and how far the host may send: nothing is sent
//! without room for it.
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
//! [`ESCAPE`] and the byte with its highest bit inverted. So a frame has no line end, no `M` and no
//! flow control in it: a command that acts as its bytes arrive (M112, M108, M410) cannot be in a
//! frame, and is noticed between any two. Only if two or more bytes of a frame are changed, to a
//! line end and an `M`, can part of it be taken for such a command; a line that begins with the
//! rest of a broken frame begins with no letter.
//!
//! The board's lines are [`Report`]s: `gpre:`, a word, two numbers, a star and the CRC-32 of what
//! is before the star's blank, in eight hexadecimal digits. The board's other lines keep their
//! usual meaning.
//!
//! # The host's part
//!
//! 1. The host sends the line `M790 S<bytes>`, numbered as any other (`T<seconds>`: how long it
//!    may be silent, 30 by default). The board answers `ok` and `gpre:have 0 <limit> *<sum>`. The
//!    slicer's thumbnail is best left out (`without_thumbnail`).
//! 2. It sends the file's bytes in order, up to but not including the byte at the limit.
//! 3. The board reports `gpre:have <next> <limit> *<sum>`: everything before byte `next` has
//!    arrived, everything before `limit` may be sent. `gpre:again ...` says that byte `next` is
//!    missing, and the host resumes there. The limit never falls. A line with a wrong sum is
//!    ignored. The board has 3 KiB for a job: the longest frame of the file and 1 KiB ahead.
//! 4. After a quarter of a second without an answer the host sends a question, and the board
//!    reports what it has. A question before any data is `7E 02 00 00 00 00 00` and its CRC-32,
//!    `0A`.
//! 5. The end is `gpre:done <bytes> <frames> *<sum>`: everything has been executed. Or it is
//!    `echo:gpre: ` and a reason, then `gpre:refused <byte> <frame> *<sum>` (nothing was executed)
//!    or `gpre:stopped <byte> <frame> *<sum>` (the valid part was executed, to a standstill on the
//!    path). After that the port speaks G-code; a question brings the line again.
//!
//! Between frames a numbered line that begins with anything but 7E (`N7 M220 S50*17`) is executed
//! between two items of the job and answered as usual; other text is answered `echo:gpre: a
//! prepared job is being received ...` and `ok`. A restarted host sends a line end, then M110 and
//! the same M790; until both are answered `ok`, reports belong to its predecessor. A different
//! length gets `echo:gpre: another job is being received`. If no frame and no numbered line
//! arrives for T seconds while the machine waits for it (30 s before the first frame), the board
//! gives the host up: everything received has then been executed.

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
