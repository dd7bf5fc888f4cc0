//! Planning of moves into step events: the motion code of Ferrostep, the same on the desk
//! and on the board.
//!
//! A [`Move`] passes four stages, each a module: [`kinematics`] turns it into motor steps,
//! [`look_ahead`] finds the speeds at its ends, [`time_law`] gives s(t), and [`interpolator`] turns
//! that into [`StepEntry`]s. Short moves that continue each other become one block before
//! look-ahead. [`Planner`] connects them.
//!
//! No text, no hardware, no heap. The results are bit-identical on every target: positions and
//! times accumulate in integers, arithmetic is f32 per move, f32 per block (f64 where that is not
//! exact enough) and f32 per step, all with + - * / and square root alone.
#![cfg_attr(not(test), no_std)]

pub mod backlash;
pub mod block_queue;
pub mod bresenham;
pub mod digest;
pub mod extruder;
pub mod inner_ends;
pub mod interpolator;
pub mod kinematics;
pub mod look_ahead;
pub mod methods;
pub mod piece;
pub mod real;
pub mod s_curve;
pub mod shaping;
pub mod square_root;
pub mod step_queue;
pub mod stretches;
pub mod surface;
pub mod time_law;
pub mod time_units;

mod block;
mod budget;
mod cubic;
mod division;
mod event_buffer;
mod extruder_gap;
mod follower;
mod given_speeds;
mod junction;
mod limits;
mod motion_choice;
mod on_the_way;
mod open_block;
mod pace;
mod passing;
mod path;
mod pieces;
mod planner;
mod pressure_advance;
mod ring;
mod spacing;
mod speed_plan;
mod step_ledger;
mod step_times;
mod tolerance;
mod trapezoid;
mod u64_to_f32;
mod units;

pub use block::{Acceleration, Block, PlannedBlock, Speed, SquaredSpeed};
pub use cubic::Cubic;
pub use digest::StepDigests;
pub use follower::Follower;
pub use kinematics::{Coordinate, Geometry, Kinematics, LinearKinematics, StepsPerMm};
pub use limits::{AXES, Limits};
pub use methods::{ChoiceError, MotionMethods, Standard};
pub use motion_choice::{AccelerationProfile, DualRatePeriods, Interpolation, MotionChoice, SCurveTableSettings};
pub use pace::Pace;
pub use passing::PassedEntries;
pub use planner::advance::Progress;
pub use planner::block_rules::MIN_FEED_MM_PER_S;
pub use planner::move_error::{MoveError, Moved};
pub use planner::prepared::{Prepared, PreparedMove, Retuned};
pub use planner::recorder::{Recorded, Recorder};
pub use planner::request::{Move, Request};
pub use planner::{Planner, filament_100pm};
pub use pressure_advance::{PressureAdvance, PressureAdvanceError, SecondSlope};
pub use shaping::{AxisShaper, EvenSpacing, SMOOTH_TIME_S, ShaperError, ShaperKind, smooth_ticks};
pub use spacing::MotorSteps;
pub use step_ledger::{StepLedger, StepObserver};
pub use step_queue::{EXTRUDER, Notice, StepEntry, StepKind, StepSink};
pub use step_times::StepTimes;
pub use time_units::TICKS_PER_SECOND;
pub use tolerance::PATH_TOLERANCE_MM;

/// Version of the rules by which moves become blocks and blocks get their speeds. Raise it with any
/// change that gives a job other steps: jobs prepared by the rules of another version are not
/// executed.
pub const PLANNER_VERSION: u32 = 3;
