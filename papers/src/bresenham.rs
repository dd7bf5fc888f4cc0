//! Wu's Bresenham lines (Wu 2024): classic, and in stairs whose widths are found by one of three
//! rules.
//!
//! All rules yield the same widths:
//!
//! - [`FromFirstStair`]: as Wu proposes, without any division, with one or two decisions per stair;
//!   the first stair is counted.
//! - [`FromQuotient`]: one division per line and one decision per stair; no stair is counted.
//! - [`FromDivision`]: one division per stair, like the interpolator's [`StepBresenham`]: 14 %
//!   fewer instructions than with the quotient (`cargo xtask bench`).

mod classic;
mod decisions;
mod line;
mod stairs;
#[cfg(test)]
mod tests;
mod widths;

pub use classic::Classic;
pub use decisions::{Counted, Decisions, Uncounted};
pub use ferrostep_planner::bresenham::{LineError, MAX_STEPS, Slope, StepBresenham};
pub use line::{Line, LineStair, LineStairs, Points};
pub use stairs::{Stair, Stairs};
pub use widths::{FromDivision, FromFirstStair, FromQuotient, Widths};
