//! A printer's motion on the desk: made step by step, or only planned.

mod accelerometer;
mod desk_time;
mod drivers;
mod encoder;
mod figures;
mod heat;
mod heat_at_rest;
mod limit_factors;
mod line_ends;
mod live;
mod plan_reader;
mod queue_machine;
mod rehearsal;
mod session_motion;
mod step_queue;
mod tools;
mod z_motors;

pub(crate) use desk_time::DeskTime;

pub use accelerometer::{DeskAccelerometer, Tap};
pub use drivers::DeskDrivers;
pub use encoder::Encoder;
pub use figures::{Figures, seconds};
pub use heat::{DeskHeat, DeskHeating};
pub use limit_factors::LimitFactors;
pub use line_ends::LineEnds;
pub use live::{LiveDesk, LiveMachine};
pub(crate) use plan_reader::LEAP_TICKS;
pub use plan_reader::{PlanReader, PlannedMotion};
pub use queue_machine::QueueMachine;
pub use rehearsal::{DeskMachine, Rehearsal};
pub(crate) use session_motion::let_time_pass;
pub use session_motion::{Desk, ExtruderNow, MotionState};
pub use step_queue::VirtualStepQueue;

/// Blocks in the look-ahead ring, as on the target.
pub const LOOK_AHEAD_BLOCKS: usize = 128;
