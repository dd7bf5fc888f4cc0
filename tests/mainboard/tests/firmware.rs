//! The shipped images on the virtual mainboard act as the desk rehearsed and as
//! their boards demand.
//!
//! Everything runs in virtual time: on a busy computer a test takes longer, with the same result.
//! `cargo xtask test` builds the images first and passes their folder in `FERROSTEP_IMAGES`;
//! without it the tests use those of `target/images`, and build missing ones there.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod accelerometer;
mod backlash;
mod bad_input;
mod bench;
mod black_box;
mod bltouch;
mod board_pins;
mod boot_loader;
mod button;
mod card;
mod chamber;
mod choices;
mod eeprom;
mod emergency;
mod equipped;
mod filament_motion;
mod foreign_code;
mod halted;
mod heater_fault;
mod heater_model;
mod heaters;
mod host;
mod images;
mod job;
mod last_words;
mod noise;
mod pins;
mod port_log;
mod prepared;
mod real_hosts;
mod rehearsal;
mod same_steps;
mod shipped;
mod supply;
mod timing;
mod tools;
mod turns;
mod watchdog;
mod z_motors;
