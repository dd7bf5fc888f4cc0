//! Printer boards as TOML: their pins and clocks, checked, as the source of the
//! firmware's constants.
//!
//! The boards are the files next to this crate's `Cargo.toml`. A key is one line of code that reads
//! it (`keys.rs`), with its range, its default and its meaning; the book's table of keys is made
//! from the same lines ([`schema`]). [`constants::rust`] turns a board into the constants that the
//! firmware is compiled with.
#![forbid(unsafe_code)]

mod board;
mod chip;
pub mod chosen;
pub mod clock;
pub mod constants;
pub mod fit;
mod keys;
mod pin;
mod pins;
pub mod registers;
mod signals;
mod start;
mod store;

pub use board::{
    Accelerometer, AccelerometerChip, BBF_HEADER_BYTES, BBF_SUFFIX, Board, CCM_ADDRESS, Driver, DriverUart, Eeprom,
    EepromChip, FLASH_ADDRESS, Fan, Heater, Motor, RAM_ADDRESS, Thermistor,
};
pub use chip::Chip;
pub use ferrostep_checked_toml::{FileError as BoardError, Problem};
use ferrostep_checked_toml::{Reader, Schema};
pub use pin::Pin;
pub use signals::AnalogueChannel;
pub use store::Store;

// ANCHOR: builtin
/// Names and texts of the boards that need no file. The first is the default.
const BUILTIN: [(&str, &str); 3] = [
    ("bench", include_str!("../bench.toml")),
    ("btt-octopus-1.1", include_str!("../btt-octopus-1.1.toml")),
    ("prusa-buddy", include_str!("../prusa-buddy.toml")),
];
// ANCHOR_END: builtin

/// The board that the firmware is built for without `--board`.
pub const DEFAULT: &str = BUILTIN[0].0;

/// Names that [`load`] knows without a file, in alphabetical order.
pub fn builtin_names() -> impl Iterator<Item = &'static str> {
    BUILTIN.iter().map(|(name, _)| *name)
}

/// Text of the built-in board of this name.
pub fn builtin_text(name: &str) -> Option<&'static str> {
    BUILTIN.iter().find(|(builtin, _)| *builtin == name).map(|(_, text)| *text)
}

/// Loads a built-in board by its name, or else the file at this path.
///
/// # Errors
///
/// [`Problem::Read`] if the file cannot be read, is not UTF-8 or is larger than 1 MiB;
/// otherwise as [`parse`].
pub fn load(name_or_path: &str) -> Result<Board, BoardError> {
    match builtin_text(name_or_path) {
        Some(text) => parse(text, name_or_path),
        None => parse(&ferrostep_checked_toml::read(name_or_path, "board", builtin_names())?, name_or_path),
    }
}

/// Parses and checks a board; `origin` (a path or a name) precedes the line number in errors.
///
/// # Errors
///
/// The first problem found: TOML syntax, then unknown, missing or mistyped keys, then values out of
/// their range, then pins and channels that contradict each other.
pub fn parse(text: &str, origin: &str) -> Result<Board, BoardError> {
    let reader = Reader::new(text, origin)?;
    let board = keys::board(&reader.root());
    reader.finish(board).map(|checked| checked.value)
}

/// The keys of a board.
pub fn schema() -> Schema {
    Reader::describe(keys::board)
}
