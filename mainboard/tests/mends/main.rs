//! Hazards of `docs/src/hazards.md` that a chip can show, on the image as it is flashed: each test fails on an image from before
//! the mend.
//!
//! The image is `target/images/prusa-buddy/ferrostep.elf` of the repository (`cargo xtask firmware --board prusa-buddy`). Another
//! one, of another time, is tried with `FERROSTEP_IMAGE=ELF`, and with `FERROSTEP_BOARD` and `FERROSTEP_PROFILE`, its own board's
//! and profile's files.
//!
//!     cargo test --release --test mends

#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]

mod boot_loader;
mod fans;
mod leftovers;
mod pulses;
mod scene;
mod stub;
mod watchdog;
