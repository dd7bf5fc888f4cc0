//! The printer of `ferrostep serve`, and hosts at its port: our own, printcore, OctoPrint and the web page's.
//!
//! `cargo xtask test` installs the hosts first and names their folder in `FERROSTEP_HOSTS`; without it the tests have it done.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod accelerometer;
mod black_box;
mod browser;
mod card;
mod conversation;
mod octoprint;
mod page;
mod printcore;
mod printer;
mod sending;
mod settings;
