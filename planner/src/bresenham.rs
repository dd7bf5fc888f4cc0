//! Step Bresenham (Wu 2024): lines by stairs.
//!
//! A *stair* is a run of steps of the major axis whose last step the minor axis joins. Classic
//! Bresenham decides every step, step Bresenham every stair, with the same points. Above slope 1/2
//! such stairs have one or two steps; there, stairs are made of the complement: runs of steps of
//! both axes that end with a step of the major axis alone. So a line of dx by dy steps has min(dy,
//! dx - dy) whole stairs, whatever its slope.
//!
//! [`StepBresenham`] divides once a stair, when its width is requested. The width can be requested
//! at any point of a stair and for both kinds of stair; a line whose width is never requested costs
//! an addition and a decision per step and nothing in advance. The interpolator needs this: in
//! ramps each step has its own time, and in the cruise the extruder and the other motor end stairs
//! early. Wu's own rules, which avoid that division, are in the papers' crate.

mod slope;
mod step;

pub use slope::{LineError, MAX_STEPS, Slope};
pub use step::StepBresenham;
