//! The printer of `ferrostep serve`, and hosts at its port: Ferrostep's and the web page's. Hosts
//! and a browser that others wrote are in `tests/outside`.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod accelerometer;
mod black_box;
mod by_hand;
mod card;
mod conversation;
mod page;
mod sending;
mod settings;
mod slicer;
