//! The memory card slot.

use core::fmt;

pub use embedded_sdmmc_types::{Block, BlockCount, BlockDevice, BlockIdx};

/// Reason for which a card could not be read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CardError {
    /// No card is in the slot.
    Missing,
    /// The card has not answered in time.
    Silent,
    /// A transfer was damaged: a checksum is wrong, or bytes were lost.
    Garbled,
    /// The slot cannot use this card.
    Unsupported,
    /// The card has no such block, or more blocks were requested than files and folders can need:
    /// its folders or its cluster table are damaged.
    Damaged,
}

impl fmt::Display for CardError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Missing => "no card is in the slot",
            Self::Silent => "the card does not answer",
            Self::Garbled => "the card's data arrive changed",
            Self::Unsupported => "this kind of card is not supported",
            Self::Damaged => "the card's folders are damaged",
        })
    }
}

impl core::error::Error for CardError {}

/// A card slot: a device of 512-byte blocks, once the inserted card has been started.
///
/// Calls return within [`MAX_BLOCK_MS`]. They may wait, so they belong in the task of the lowest
/// priority.
pub trait CardSlot: BlockDevice<Error = CardError> {
    /// Returns true if a card is in the slot; always true on a board without card detection.
    fn is_inserted(&self) -> bool;
    /// Starts the card in the slot, as after insertion. A card that was removed must be started
    /// again.
    ///
    /// # Errors
    /// The slot is empty, or cannot use the card.
    fn start(&self) -> Result<(), CardError>;
    /// Returns true if the card started last has been in the slot ever since: a card that was
    /// removed and inserted again has not.
    fn is_still_started(&self) -> bool;
}

/// Longest time that a slot takes for a block or for starting a card, ms. Cards may take 250 ms to
/// write a block and 1 s to start (SD Physical Layer Specification 4.6.2 and 4.2.3).
pub const MAX_BLOCK_MS: u32 = 1100;
