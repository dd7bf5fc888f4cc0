//! Simulates a train of steps, or a plan, on a frame that rings and a nozzle under pressure.
//!
//! [`steps`] plays step events from a trace or from a plan; [`plan`] plays laws of motion without
//! steps. A plan comes from the oracle, or from moves of another planner with their speeds. Both
//! feed the same [`frame`] and [`nozzle`], and [`measures`] reports how far the nozzle is from the
//! programmed path and how much material is misplaced. [`shapers`] and [`law`] are the f64
//! definitions of shaped motion with which the firmware's is compared.
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
