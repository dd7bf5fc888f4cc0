//! What the command can do.

pub mod count;
pub mod print;
pub mod serve;
pub mod setup;
