//! Analyses jobs and machines: a print's record for its page, its error on a frame that rings,
//! its time with other settings, two prints side by side; and a machine's settings from
//! measurements or prints.
//!
//! A program begins with [`job_machine::JobMachine`], the machine of a job with the rules of its
//! moves, and a `Session` that executes the job on it: `examples/moves.rs` prints each move with
//! its time and the limit that held it.

pub mod calibrate;
pub mod compare;
pub mod job_machine;
pub mod method_comparison;
pub mod recording;
pub mod simulation;
pub mod sweep;
pub mod took;
mod without_commands;
