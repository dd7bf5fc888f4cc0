//! Bresenham's lines, classic and by stairs (Wu 2024).
//!
//! A *stair* is a run of steps of the major axis that ends with one that the minor axis joins. Classic Bresenham decides
//! every step, step Bresenham every stair, with the same points. Above slope 1/2 stairs in that sense have one or two
//! steps; there they are made of the complement, runs of steps of both axes that end with one of the major axis alone. So
//! a line of dx by dy steps has min(dy, dx - dy) whole stairs, whatever its slope.
//!
//! Three rules tell how wide a stair is, and all tell the same:
//!
//! - [`FromFirstStair`]: as Wu proposes it, without any division, by one or two decisions a stair; the first stair is
//!   counted.
//! - [`FromQuotient`]: one division a line and one decision a stair; no stair is counted. It is what whole lines should be
//!   walked with: a division a stair takes 2 % fewer instructions (`cargo xtask bench`), but each of its divisions up to
//!   12 cycles.
//! - [`StepBresenham`]: a division a stair, when it is asked for. It can be asked at any point of a stair and answers for
//!   both kinds of stair, and a line of which no width is asked for costs an addition and a decision a step and nothing in
//!   advance. That is what the interpolator needs: in ramps each step has a time of its own, and in the cruise the
//!   extruder and the other motor end stairs early.

mod classic;
mod decisions;
mod line;
mod slope;
mod stairs;
mod step;
#[cfg(test)]
mod tests;
mod widths;

pub use classic::Classic;
pub use decisions::{Counted, Decisions, Uncounted};
pub use line::{Line, LineStair, LineStairs, Points};
pub use slope::{LineError, MAX_STEPS, Slope};
pub use stairs::{Stair, Stairs};
pub use step::StepBresenham;
pub use widths::{FromFirstStair, FromQuotient, Widths};
