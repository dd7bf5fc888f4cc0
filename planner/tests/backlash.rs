//! Play is taken up at the reversals of a motor, and the plan's steps do not change.
#![allow(clippy::unwrap_used)]

mod axis;
mod follows;
mod machine;
mod picture;
mod stops;
