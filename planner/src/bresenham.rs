//! Step Bresenham (Wu 2024): lines by stairs.
//!
//! A *stair* is a run of steps of the major axis that ends with one that the minor axis joins.
//! Classic Bresenham decides every step, step Bresenham every stair, with the same points. Above
//! slope 1/2 stairs in that sense have one or two steps; there they are made of the complement,
//! runs of steps of both axes that end with one of the major axis alone. So a line of dx by dy
//! steps has min(dy, dx - dy) whole stairs, whatever its slope.
//!
//! [`StepBresenham`] divides once a stair, when its width is asked for. It can be asked at any
//! point of a stair and answers for both kinds of stair, and a line of which no width is asked for
//! costs an addition and a decision a step and nothing in advance. The interpolator needs this: in
//! ramps each step has its own time, and in the cruise the extruder and the other motor end stairs
//! early. Wu's own rules, which do without that division, are in the papers' crate.

mod slope;
mod step;

pub use slope::{LineError, MAX_STEPS, Slope};
pub use step::StepBresenham;
