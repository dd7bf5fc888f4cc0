//! Pins to motion: what the edges of the step and direction pins were, and whether that is what the planner on the desk
//! had in mind.
//!
//! [`Decoder`] takes edges and yields step events; [`Trace`] reads what the desk wrote; [`compare`] holds the two against
//! each other, in order and in time.

mod compare;
mod digest;
mod pins;
mod trace;

pub use compare::{Comparison, Difference, HISTOGRAM_NS, Late, Rules, compare};
pub use digest::order_digest;
pub use pins::{Decoder, Event, MotorWires, Smallest};
pub use trace::{Redefined, Trace, TraceStep};

#[cfg(test)]
mod tests;
