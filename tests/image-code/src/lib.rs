//! The instructions of a firmware image: their targets, the longest time of the step interrupt, the
//! time for which interrupts are masked, and the depth of the stack.
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
