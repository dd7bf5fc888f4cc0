//! Speed that changes at a constant jerk (Li 2017): an acceleration that rises from zero and
//! falls back to it.
//!
//! Li's five segments are a ramp up, a cruise and a ramp down, each ramp two halves of the jerks +j
//! and -j. Here a ramp holds its acceleration where that reaches its limit, which makes seven.

pub(crate) mod law;
pub(crate) mod run;
#[cfg(test)]
pub(crate) mod textbook;

pub mod bounds;

pub use run::{Jerk, Jerks, Run};
