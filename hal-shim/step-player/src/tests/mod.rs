//! Feeder and player against a model of the timer, and against the virtual board's motors, which
//! play the same entries directly.

mod flags;
mod further;
pub mod interleave;
mod missed;
mod model;
mod past;
mod play;
mod rate;
mod stop;
