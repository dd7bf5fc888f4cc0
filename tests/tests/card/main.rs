//! Prints from a memory card: what hosts see of it, and what becomes of a print whose card is pulled out.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod commands;
mod prints;
mod pulls;
mod setup;
