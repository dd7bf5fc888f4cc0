//! The instructions of a firmware image: where they lead, how long the step interrupt takes by them, how long interrupts
//! are masked, and how deep the stack gets.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

pub mod called_constant;
pub mod code;
mod cycles;
pub mod flow;
mod graph;
pub mod interrupt_time;
pub mod masked;
pub mod stack;
pub mod stack_need;
