//! The subcommands of the virtual mainboard.

pub mod count;
pub mod print;
pub mod serve;
pub mod setup;
