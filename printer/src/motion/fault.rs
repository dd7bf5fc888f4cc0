//! Reasons why motion was not possible, and faults that the firmware may find in its own.

use ferrostep_planner::MoveError;

/// Reason why motion was not possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionError {
    /// The planner refused the move.
    Move(MoveError),
    /// Motion was stopped (M112, M410) before it ended.
    Stopped,
    /// The firmware has found a fault in its own motion and stopped it.
    Fault(MotionFault),
}

/// A difference between plan and motion: an error of the firmware or of the chip.
/// Motion has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionFault {
    /// A motor is not where its block ends.
    Miscount(Miscount),
    /// A step was planned nearer to the one before than the drivers or the step interrupt allow.
    StepsTooNear,
    /// The step interrupt has missed this many updates of its timer within a few milliseconds.
    MissedUpdates(u32),
}

/// A motor that is not where its block ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Miscount {
    /// The motor: X, Y, Z (CoreXY: A, B, Z), extruder.
    pub motor: usize,
    /// Position by its steps, steps.
    pub counted: i64,
    /// End of the block, steps.
    pub expected: i64,
}

impl Miscount {
    /// The first motor that is not where it must be; `None` if all are.
    pub fn between(counted: [i64; 4], expected: [i64; 4]) -> Option<Self> {
        let motors = counted.into_iter().zip(expected).enumerate();
        let mut wrong = motors.filter(|(_, (counted, expected))| counted != expected);
        wrong.next().map(|(motor, (counted, expected))| Self { motor, counted, expected })
    }
}

/// Result of a move towards a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomingOutcome {
    /// The sensor triggered; the motors are there.
    Triggered,
    /// The move ended without it.
    Missed,
}
