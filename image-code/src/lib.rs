//! The instructions of a firmware image: where they lead, and how long the step interrupt takes by them.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

pub mod code;
pub mod flow;
pub mod interrupt_time;
