//! The bed is probed and followed: on the virtual board, whose sheet is tilted and bent.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod commands;
mod edges;
mod faults;
mod first_layer;
mod jobs;
mod repeatability;
mod rig;
mod round;
mod screws;
mod z_motors;
