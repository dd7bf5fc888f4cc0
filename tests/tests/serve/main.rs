//! The printer of `ferrostep serve`, and hosts at its port: our own, printcore and OctoPrint.
//!
//! `cargo xtask test` installs the hosts first and names their folder in `FERROSTEP_HOSTS`; without it the tests have it done.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod card;
mod conversation;
mod octoprint;
mod printcore;
mod printer;
mod sending;
