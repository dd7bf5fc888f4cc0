//! A train of steps, or a plan, through a frame that rings and a nozzle under pressure.
//!
//! [`steps`] plays step events as a trace has them or as a plan makes them, [`plan`] plays laws of
//! motion without steps; a plan is the oracle's, or moves of another planner with their speeds.
//! Both feed the same [`frame`] and [`nozzle`], and [`measures`] reports how far the nozzle is from
//! the programmed path and how much material is out of place. [`shapers`] and [`law`] are the f64
//! definitions of shaped motion that the firmware's is compared with.
//!
//! This crate depends on no code of the firmware.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

pub mod frame;
pub mod law;
pub mod measures;
pub mod motion;
pub mod nozzle;
pub mod path;
pub mod plan;
pub mod plot;
pub mod shapers;
pub mod steps;
