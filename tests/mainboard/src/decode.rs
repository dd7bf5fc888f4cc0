//! Decodes the edges of step and direction pins into steps, and compares them with the
//! plan of the desk.
//!
//! [`Decoder`] takes edges and yields step events; [`Trace`] reads the desk's trace; [`compare`]
//! compares the two in order and in time.

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
