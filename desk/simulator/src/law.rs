//! Laws of motion in pieces, and what a filter makes of them: the reference for
//! shaped motion, in f64.

mod cursor;
mod pieces;
mod shaped;
mod solver;

pub use cursor::ShapedCursor;
pub use pieces::{Law, LawError, Piece};
pub use shaped::ShapedLaw;
pub(crate) use solver::follow;
pub use solver::{StepTime, step_times};

#[cfg(test)]
mod tests;
