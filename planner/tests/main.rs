//! The planner from outside, as one program: each takes long to link.

mod backlash;
mod boundaries;
mod foreseen;
mod inner_ends;
mod on_the_way;
mod path_tolerance;
mod prepared;
mod ringing;
mod s_curve_runs;
mod shaped;
mod shapers;
mod surface;
mod textbook;
