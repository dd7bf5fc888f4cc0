//! Settings that survive a power-off.
//!
//! A [`Record`] holds values by the names of their settings; a [`Store`] keeps the newest record in
//! sectors of a NOR flash. A power cut at any word leaves the previous record or the new one.
#![cfg_attr(not(test), no_std)]

mod memory_flash;
mod record;
mod store;

pub use memory_flash::{Cut, MemoryFlash, PowerIsOff, next_random};
pub use record::{Entry, MAX_BYTES, MAX_VALUES, Record, RecordError, RecordWriter, hash_of, id_of};
pub use store::{NOT_WORKING, SLOT_BYTES, Slot, Store, StoreError};
