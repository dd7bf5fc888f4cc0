//! Analyses jobs and machines: a print's record for its page, its error on a frame that rings,
//! its time with other settings, two prints side by side; and a machine's settings from
//! measurements or prints.

pub mod calibrate;
pub mod compare;
pub mod job_machine;
pub mod method_comparison;
pub mod recording;
pub mod simulation;
pub mod sweep;
pub mod took;
mod without_commands;
