//! The planner as a whole, over arbitrary moves: positions, order, spacing and the time law of
//! every block, whatever the method and the law of acceleration.

#![allow(clippy::unwrap_used, missing_docs)]

mod blocks;
mod checks;
mod law;
mod machine;
mod merging;
mod methods;
mod moves;
mod pace;
mod player;
mod requests;
mod stops;
