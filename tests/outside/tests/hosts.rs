//! Hosts that others wrote, at the port of the served printer: printcore and OctoPrint; and
//! Moonraker, which corrects files; and a stand-in of OrcaSlicer. All are Python's.
//!
//! `cargo xtask test` installs the hosts first and names their folder in `FERROSTEP_HOSTS`; without
//! it the tests have it done.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod moonraker;
mod octoprint;
mod octoprint_estimates;
mod orcaslicer;
mod printcore;
mod slicer_client;
