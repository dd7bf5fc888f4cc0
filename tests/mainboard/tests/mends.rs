//! Hazards of `docs/src/hazards.md` that a chip can show, on the image as it is flashed: each test
//! fails on an image from before the mend.
//!
//! The image is `target/images/prusa-buddy/ferrostep.elf` of the repository
//! (`cargo xtask firmware --board prusa-buddy`). To test an image of another time, set
//! `FERROSTEP_IMAGE=ELF`, and `FERROSTEP_BOARD` and `FERROSTEP_PROFILE` to its board's and
//! profile's files.
//!
//!     cargo test --release mends::

#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]

mod boot_loader;
mod fans;
mod leftovers;
mod pulses;
mod scene;
mod stub;
mod watchdog;
