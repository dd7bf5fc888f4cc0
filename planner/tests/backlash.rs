//! Play is taken up where a motor turns, and nothing else changes.
#![allow(clippy::unwrap_used)]

mod axis;
mod follows;
mod machine;
mod picture;
mod stops;
