//! From moves to step events: the motion code of Ferrostep, the same on the desk and on the board.
//!
//! A [`Move`] passes four stages, each a module: [`kinematics`] turns it into motor steps, [`look_ahead`] finds the
//! speeds at its ends, [`time_law`] gives s(t), and [`interpolator`] turns that into [`StepEntry`]s. Short moves that
//! continue each other become one block before look-ahead.
//! [`Planner`] connects them.
//!
//! No text, no hardware, no heap. The results are bit-identical on every target: positions and times accumulate in
//! integers, arithmetic once a move is f32, once a block f32 or, where that is not exact enough, f64, once a step f32, all
//! with + - * / and square root alone.
#![cfg_attr(not(test), no_std)]

pub mod bresenham;
pub mod digest;
pub mod extruder;
pub mod inner_ends;
pub mod interpolator;
pub mod kinematics;
pub mod look_ahead;
pub mod plane;
pub mod s_curve;
pub mod step_queue;
pub mod time_law;

mod block;
mod block_queue;
mod budget;
mod division;
mod event_buffer;
mod extruder_gap;
mod follower;
mod given_speeds;
mod junction;
mod limits;
mod method;
mod motion_choice;
mod offered;
mod open_block;
mod pace;
mod path;
mod piece;
mod planner;
#[cfg(test)]
mod random;
mod real;
mod ring;
mod spacing;
mod square_root;
mod step_ledger;
mod step_times;
mod time_units;
mod trapezoid;
mod u64_to_f32;

pub use block::{Acceleration, Block, PlannedBlock, Speed, SquaredSpeed};
pub use digest::StepDigests;
pub use kinematics::{Coordinate, Geometry, Kinematics, LinearKinematics, StepsPerMm};
pub use limits::{AXES, Limits};
pub use motion_choice::{AccelerationProfile, DualRatePeriods, Interpolation, MotionChoice, SCurveTableSettings};
pub use pace::Pace;
pub use planner::{
    MIN_FEED_MM_PER_S, Move, MoveError, Moved, Planner, Prepared, PreparedBlock, PreparedMove, Progress, Recorded,
    Recorder, Request, Retuned, filament_100pm,
};
pub use step_ledger::{StepLedger, StepObserver};
pub use step_queue::{Notice, StepEntry, StepKind, StepSink};

/// Frequency of the nominal time base, in ticks a second.
///
/// Every planned time is a number of these ticks. A board whose timer runs at another frequency stretches time; it
/// never plans other ticks.
pub const TICKS_PER_SECOND: u32 = 84_000_000;

/// Version of the rules by which moves become blocks and blocks get their speeds. To be raised with any change that gives
/// a job other steps: jobs that were prepared by the rules of another version are not executed.
pub const PLANNER_VERSION: u32 = 3;

/// Bit of the extruder in an axis mask; X (A), Y (B) and Z are bits 0 to 2.
pub const EXTRUDER: u8 = 1 << 3;
