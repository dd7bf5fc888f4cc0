//! The whole machine at work: the `ferrostep` command and the library it is made of, held against the independent
//! reference of this crate.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod accelerations;
mod bad_input;
mod command;
mod core_xz;
mod desk;
mod drivers;
mod entries;
mod estimates;
mod exactness;
mod extrusion;
mod hazards;
mod heater_faults;
mod homing_places;
mod hostile;
mod hosts;
mod idle_heaters;
mod methods;
mod odd_lines;
#[cfg(unix)]
mod outputs;
mod overflow;
mod papers;
mod prepared;
mod prints;
mod programs;
#[cfg(unix)]
mod pty_board;
mod refusals;
mod refusals_page;
mod repeats;
mod reports;
#[cfg(unix)]
mod sending;
mod slaved_extruder;
mod stall;
mod waits;
mod waveform;
