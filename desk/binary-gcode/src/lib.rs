//! Binary G-code (`.bgcode`), read in bounded memory.
//!
//! `no_std`, no heap, no panics: every byte sequence is answered. The format is Prusa's, as its
//! specification has it (<https://github.com/prusa3d/libbgcode>, `doc/specifications.md`): a
//! header, then blocks of metadata, pictures and G-code, each with its own compression and CRC-32.
//!
//! [`Decoder`] takes the file's bytes in portions of any size and gives out what the blocks
//! contain. It does no reading itself, so it serves a blocking reader, an asynchronous one, and
//! bytes in memory in the same way:
//!
//! ```
//! use ferrostep_binary_gcode::{BlockKind, Decoder, Progress, Selection};
//!
//! fn gcode(file: &[u8]) -> Result<Vec<u8>, ferrostep_binary_gcode::Error> {
//!     let mut decoder = Decoder::new(Selection::GCODE);
//!     let (mut portion, mut text) = ([0; 512], Vec::new());
//!     loop {
//!         // A card reader would seek to this place, and read from there.
//!         let bytes = file.get(decoder.position() as usize..).unwrap_or_default();
//!         match decoder.advance(&bytes[..bytes.len().min(100)], &mut portion)? {
//!             Progress::More => {}
//!             Progress::Contents(_, length) => text.extend_from_slice(&portion[..length]),
//!             Progress::End => return Ok(text),
//!         }
//!     }
//! }
//! assert!(gcode(b"G28\n").is_err());
//! ```
//!
//! The decoder needs 4.5 KiB, most of it heatshrink's window; with the feature `deflate` about 48
//! KiB. Without that feature G-code compressed with Deflate is refused.
//!
//! The feature `write` adds [`Form`], which writes a block's new contents as its old ones were
//! written; it needs a heap.
#![cfg_attr(not(test), no_std)]

#[cfg(feature = "write")]
extern crate alloc;

mod block_kind;
mod checksum;
mod decoder;
mod error;
#[cfg(feature = "write")]
mod form;
mod format;
mod heatshrink;
#[cfg(feature = "deflate")]
mod inflate;
mod metadata;

pub use block_kind::{BlockKind, ThumbnailFormat};
pub use decoder::{Decoder, Progress, Selection};
pub use error::{Error, Reason};
#[cfg(feature = "write")]
pub use form::{FileForm, Form};
pub use format::MAGIC;
pub use metadata::{entries, seconds};
