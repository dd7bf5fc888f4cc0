//! The content of the firmware's images: layout, code and files. Their behaviour is tested on the
//! virtual mainboard, in `tests/mainboard/tests`.
//!
//! `cargo xtask test` builds the images first and names them in `FERROSTEP_FIRMWARE` and
//! `FERROSTEP_IMAGES`; without them the tests build them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod board_files;
mod handlers;
mod image;
mod masked_sections;
mod masks;
mod stack;
mod step_interrupt;
