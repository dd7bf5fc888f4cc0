//! A second opinion on every job: G-code in, exact positions and a plain f64 plan out.
//!
//! [`interpret`] reads the text, [`plan`] gives each move its speeds with unlimited look-ahead (or
//! a window), and [`MotorScale`] gives the motors' positions. Written from the definitions alone,
//! for clarity and not for speed.

mod arc;
mod decimal;
mod interpret_error;
mod interpreter;
#[cfg(test)]
mod interpreter_tests;
mod job;
mod line;
mod planner;
mod position;
mod profile;
mod trapezoid;

pub use decimal::{Decimal, UNITS_PER_MM};
pub use interpret_error::InterpretError;
pub use interpreter::{InterpretOptions, interpret};
pub use job::{EXTRUDER_FRACTIONS_PER_UNIT, Job, Limits, Move, MoveKind};
pub use planner::{Plan, PlannedMove, plan};
pub use position::{ExtruderSteps, MotorScale};
pub use profile::{Acceleration, FirmwareRetraction, Kinematics, ProfileError, ReferenceProfile};
pub use trapezoid::Trapezoid;

/// Interprets and plans a job and returns its motion time in seconds: the sum of its moves'
/// durations, homing and waits left out.
///
/// # Errors
/// As [`interpret`].
pub fn motion_time_s(
    gcode: &[u8],
    profile: &ReferenceProfile,
    options: InterpretOptions,
) -> Result<f64, InterpretError> {
    Ok(plan(&interpret(gcode, profile, options)?, None).motion_time_s)
}
