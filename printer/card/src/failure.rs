//! Reasons why a task with the card could not be done.

use core::fmt;

use ferrostep_hal_shim::card::CardError;

/// Reason why a task with the card could not be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CardFailure {
    /// The card, or its slot.
    Slot(CardError),
    /// The card was not mounted (M21), or was released (M22).
    NotMounted,
    /// The card has no FAT16 or FAT32 volume.
    NoVolume,
    /// The card is formatted with exFAT.
    ExFat,
    /// The file or folder does not exist.
    NotFound,
    /// The path is a folder.
    IsFolder,
    /// A file of this name cannot be created.
    BadName,
    /// The file must not be changed.
    ReadOnly,
    /// The card is full.
    Full,
    /// The file differs from the one opened before.
    OtherFile,
    /// No file is open.
    NoFile,
    /// The file is binary G-code.
    BinaryGcode,
    /// No interrupted print is kept on the card.
    NothingKept,
}

impl From<CardError> for CardFailure {
    fn from(error: CardError) -> Self {
        Self::Slot(error)
    }
}

impl fmt::Display for CardFailure {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Slot(error) => fmt::Display::fmt(error, out),
            Self::NotMounted => out.write_str("the card is not mounted: M21 mounts it"),
            Self::NoVolume => out.write_str("no FAT16 or FAT32 volume is on it: format it with FAT32"),
            Self::ExFat => out.write_str("it is formatted with exFAT, which cannot be read: format it with FAT32"),
            Self::NotFound => out.write_str("file not found"),
            Self::IsFolder => out.write_str("it is a folder"),
            Self::BadName => {
                out.write_str("names of new files have at most 8 characters and 3 after the dot, none of them a space")
            }
            Self::ReadOnly => out.write_str("the file is read-only"),
            Self::Full => out.write_str("the card is full"),
            Self::OtherFile => out.write_str("the file differs from the one that was being printed"),
            Self::BinaryGcode => out.write_str(
                "binary G-code is not printed from a card: let the slicer write text, or use ferrostep send or preprocess",
            ),
            Self::NoFile => out.write_str("no file is selected: M23 selects one"),
            Self::NothingKept => out.write_str("no interrupted print is kept on it"),
        }
    }
}
