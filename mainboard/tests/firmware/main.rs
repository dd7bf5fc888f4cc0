//! The shipped images on the virtual mainboard do what the desk rehearsed and what their boards ask for.
//!
//! All of it in virtual time: a test on a busy computer takes longer, and finds the same. `cargo xtask test` builds the
//! images first and names their folder in `FERROSTEP_IMAGES`; without it the tests take those of `target/images`, and build
//! what is missing there.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod bad_input;
mod bench;
mod board_pins;
#[path = "../../../tests/tests/firmware/boards.rs"]
mod boards;
mod boot_loader;
mod choices;
mod emergency;
mod foreign_code;
mod heater_fault;
mod heaters;
mod host;
mod images;
mod job;
mod last_words;
mod noise;
mod pins;
mod port_log;
mod prepared;
mod rehearsal;
mod same_steps;
mod shipped;
mod timing;
mod watchdog;
