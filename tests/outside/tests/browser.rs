//! Chromium, driven by Python, loads the pages of `show`, `compare` and `serve --web`, and the page
//! that reads a print, and takes their pictures.
//!
//! The browser is the first on the path, or `FERROSTEP_CHROMIUM`; its driver is among the hosts of
//! `FERROSTEP_HOSTS`.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod pictures;
mod read;
mod served;
mod shown;
