//! Laws of motion in pieces, and their shaped forms: the f64 reference for shaped motion.

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
