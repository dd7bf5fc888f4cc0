//! Straight lines in a plane by pulses: the three methods of the CoreXY paper.
//!
//! The paper ("CoreXY plane control for FDM printers", Hebei University of Technology) takes them
//! from machine tools. [`PointByPoint`] and [`MinimumDeviation`] decide pulse by pulse between the
//! possible directions of a pulse; [`DualRate`] is the paper's own, with a pulse period for each
//! motor. [`CoreXyLine`] gives the steps of a CoreXY machine's two motors under each method,
//! [`LineFigures`] the resulting distance from the line.

mod core_xy;
mod dual_rate;
mod figures;
mod minimum_deviation;
mod motors;
mod point_by_point;
mod target;

pub use core_xy::{CoreXyLine, LineEvent, PlaneMethod};
pub(crate) use dual_rate::is_dead_zone;
pub use dual_rate::{DualRate, TwoRates, periods_from_us};
pub use figures::LineFigures;
pub use minimum_deviation::MinimumDeviation;
pub(crate) use motors::{CoreXyTarget, FeedSteps, MotorPulse};
pub use point_by_point::PointByPoint;
pub use target::{PlaneError, Pulse};
