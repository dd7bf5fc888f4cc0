//! The firmware image in an emulator prints what the desk rehearsed: the same steps, whatever the serial line does.
//!
//! `cargo xtask test` builds the image first and names it in `FERROSTEP_FIRMWARE`; without it the tests build it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod bad_input;
mod board_files;
mod board_pins;
mod boards;
mod boot_loader;
mod choices;
mod emergency;
mod handlers;
mod heater_fault;
mod heaters;
mod image;
mod job;
mod last_words;
mod masks;
mod prepared;
mod rehearsal;
mod same_steps;
mod stack;
mod step_interrupt;
mod thermistors;
mod timing;
mod watchdog;
