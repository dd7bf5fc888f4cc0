//! The black box: the last commands, temperatures, driver events and halts, in memory that survives
//! a reset, and the transfer of these and of the step queue's last slots to the desk.
//!
//! The board writes [`Record`]s into a [`RecordMemory`]; [`Dump`] turns them and the step queue's
//! past into lines of text. The desk reads the bytes of those lines ([`Contents`]), and
//! `ferrostep-step-player` plays the steps again.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

mod contents;
mod dump;
mod memory;
mod record;
mod varint;

pub use contents::{Contents, Identity, ReadError, Slots};
pub use dump::{Dump, END, Facts, LINE_BYTES, LINE_CHARS, PREFIX, StepPast};
pub use memory::{Found, RecordMemory};
pub use record::{HeaterSample, MAX_COMMAND_BYTES, MAX_TEXT_BYTES, Record, RecordReader, Stamped};

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
