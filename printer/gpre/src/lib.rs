//! GPRE: jobs that were planned on the computer and are executed by the board (Yu 2019).
//!
//! The [`compact`] encoding spends about five bytes on a move; the paper's own, 84 bytes a move, is
//! in the papers' crate and has the same [`header`]. The reader does not trust the file: malformed
//! content is an error that says where, and well-formed content only says what to do, not that the
//! machine may do it.
//!
//! The reader has no heap, no panics and no unsafe code. The writer (feature `write`) is
//! for the computer.
#![cfg_attr(not(any(test, feature = "write")), no_std)]

#[cfg(feature = "write")]
extern crate std;

pub mod compact;
pub mod header;
pub mod parts;
pub mod transfer;

mod bits;
mod checksum;
mod error;
mod item;

pub use error::{Fault, ReadError};
pub use header::{Encoding, Header, Thumbnail, ThumbnailFormat};
pub use item::{Coordinate, EntrySpeed, Item, LimitValues, ModalState, PreparedMove, SquaredSpeed};
