//! Motion: from the words of a move to the step queue.
//!
//! `interpreter` and `modal` know what the G-code means, `homing` where the machine is; [`machine`]
//! drives planner and queue.

mod arc;
pub(crate) mod axis_names;
mod bltouch;
pub(crate) mod extrusion;
pub(crate) mod fault;
pub(crate) mod homing;
pub(crate) mod interpreter;
pub(crate) mod length;
pub mod machine;
pub(crate) mod modal;
pub(crate) mod shared_machine;
pub(crate) mod skew;
