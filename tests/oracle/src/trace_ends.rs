//! Positions of the motors at each move's end, counted step by step from a trace, against those of
//! the definitions.
//!
//! Uses the text, the profile and the trace, but no planner and no time law: a difference
//! means lost steps.

use crate::reference::{InterpretOptions, MotorScale, ReferenceProfile, interpret};
use crate::trace::{Record, TraceReader};
use crate::trace_check::TraceCheckError;
use std::io::Read;

/// A motor that ends a move at the wrong step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WrongEnd {
    /// The move's source line.
    pub line: u32,
    /// Index of the motor: x, y, z, e.
    pub motor: usize,
    /// Position, steps.
    pub position: i64,
    /// The right position, steps.
    pub expected: i64,
}

/// Result of a count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ends {
    /// Ends of moves.
    pub moves: u64,
    /// Ends at which a motor is at the wrong step, and ends that are missing or have another line.
    pub wrong: u64,
    /// The first wrong end with a motor.
    pub first: Option<WrongEnd>,
}

/// Counts through a trace of motors x, y, z, e (or a, b, z, e).
///
/// # Errors
/// The trace or the G-code cannot be read.
pub fn count_ends<R: Read>(trace: R, gcode: &[u8], profile: &ReferenceProfile) -> Result<Ends, TraceCheckError> {
    let job = interpret(gcode, profile, InterpretOptions::default()).map_err(TraceCheckError::Interpret)?;
    let scale = MotorScale::new(profile);
    let mut moves = job.moves.iter().filter(|one| one.kind.ends_with_a_record());
    let mut motors = [0i64; 4];
    let mut ends = Ends::default();
    for record in TraceReader::new(trace).map_err(TraceCheckError::Trace)? {
        match record.map_err(TraceCheckError::Trace)? {
            Record::Step(event) => {
                for (motor, position) in motors.iter_mut().enumerate().filter(|(motor, _)| event.axes >> motor & 1 == 1)
                {
                    *position += if event.directions >> motor & 1 == 1 { -1 } else { 1 };
                }
            }
            Record::PositionsRedefined { positions, .. } => {
                motors.iter_mut().zip(positions).for_each(|(motor, position)| *motor = i64::from(position));
            }
            Record::MoveEnd { line, .. } => {
                ends.moves += 1;
                let Some(one) = moves.next().filter(|one| one.line == line) else {
                    ends.wrong += 1;
                    continue;
                };
                let [x, y, z] = scale.motors(one.end_10nm);
                let expected = [x, y, z, scale.extruder(one.extruder_end).rounded];
                let mut wrong =
                    motors.into_iter().zip(expected).enumerate().filter(|(_, (at, expected))| at != expected);
                if let Some((motor, (position, expected))) = wrong.next() {
                    ends.wrong += 1;
                    ends.first.get_or_insert(WrongEnd { line, motor, position, expected });
                }
            }
        }
    }
    ends.wrong += moves.count() as u64;
    Ok(ends)
}
