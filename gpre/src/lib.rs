//! GPRE: jobs that were planned on the computer and are executed by the board (Yu 2019).
//!
//! Two encodings of one content. [`compact`] spends about five bytes on a move and is what the tools write. [`wide`] is the
//! paper's: 84 bytes a move, 12 bytes a command. The reader trusts neither: what is not well-formed is an error that says
//! where, and what is well-formed still says only what shall be done, not that the machine may do it.
//!
//! The reader has no heap, no panics and no unsafe code. The writer (feature `write`) is for the computer.
#![cfg_attr(not(any(test, feature = "write")), no_std)]

#[cfg(feature = "write")]
extern crate std;

pub mod compact;
pub mod header;
pub mod parts;
pub mod transfer;
pub mod wide;

mod bits;
mod error;
mod item;

pub use error::{Fault, ReadError};
pub use header::{Encoding, Header, Thumbnail, ThumbnailFormat};
pub use item::{Coordinate, EntrySpeed, Item, LimitValues, ModalState, PreparedMove, SquaredSpeed};

/// [`CRC`] of bytes that are all there: three instructions a byte, a word at a time, where the crate's loop has eight.
pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    let [table] = CRC.table();
    let next = |sum: u32| table[(sum & 0xff) as usize] ^ (sum >> 8);
    let (words, rest) = bytes.as_chunks::<4>();
    let sum = words.iter().fold(u32::MAX, |sum, word| next(next(next(next(sum ^ u32::from_le_bytes(*word))))));
    !rest.iter().fold(sum, |sum, byte| next(sum ^ u32::from(*byte)))
}

/// CRC-32 as Ethernet, gzip and PNG have it.
pub(crate) static CRC: crc::Crc<u32, crc::Table<1>> = crc::Crc::<u32, crc::Table<1>>::new(&crc::CRC_32_ISO_HDLC);

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_word_at_a_time_gives_the_same_sum(bytes in proptest::collection::vec(any::<u8>(), 0..100)) {
            prop_assert_eq!(super::checksum(&bytes), super::CRC.checksum(&bytes));
        }
    }
}
