//! Prints from a memory card: the conversation with hosts, and cards that are pulled out.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod commands;
mod heat_soak;
mod homing;
mod power_cuts;
mod prints;
mod pulls;
mod setup;
