//! The firmware's parts on the model of the board when the host, the executor or the planner
//! cannot keep up, and when motion is stopped at any moment. Counts and positions decide, never
//! the time a test takes.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod hangs;
mod invariants;
mod live_changes;
mod live_machine;
mod look_ahead;
mod slow_input;
mod slow_planner;
mod stops;
