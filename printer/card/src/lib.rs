//! A memory card's files, for a printer: FAT16 and FAT32 through embedded-sdmmc.
//!
//! Two sides share a [`Mailbox`]: the printer sends requests and takes results; the [`CardServer`],
//! in the task of the lowest priority, reads and writes. The card may be damaged or pulled out at
//! any time: `guard.rs` deals with the first, `source.rs` with the second.
#![cfg_attr(not(test), no_std)]

mod boot_sector;
mod failure;
mod guard;
mod kept;
mod listing;
mod local;
mod mailbox;
mod server;
mod short_name;
mod source;
mod tables;
mod volume;

pub use failure::CardFailure;
pub use kept::{KEPT_BYTES, KEPT_NAME, Kept};
pub use listing::{ListOptions, LongPath, PAGE_BYTES, ShortPath};
pub use local::LocalCard;
pub use mailbox::{Answer, CardPort, ListFrom, Mailbox, OpenedFile, Put, Request, SharedMailbox, Taken};
pub use server::CardServer;
