//! The parts of a print between two readings of a clock.
//!
//! Two programs share them: `bench` counts instructions in the emulator, `on-target`
//! cycles on a board.
#![no_std]

use ferrostep_printer::Profile;

pub mod cube_lines;
pub mod figures;
mod host_file;
pub mod machine;
pub mod pieces;
pub mod prepared;
pub mod queue;
pub mod report;
pub mod shaped;
pub mod span;
pub mod step_events;
pub mod whole_print;
pub mod wu_lines;

/// The machine of the board.
pub static PROFILE: Profile = ferrostep_profile_constant::PROFILE;
