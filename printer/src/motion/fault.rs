//! Why motion was not possible, and what the firmware may find wrong with its own.

use ferrostep_planner::MoveError;

/// Why motion was not possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionError {
    /// The planner refused the move.
    Move(MoveError),
    /// Motion was stopped (M112, M410) before it ended.
    Stopped,
    /// The firmware has found a fault in its own motion and stopped it.
    Fault(MotionFault),
}

/// A difference between plan and motion: an error of the firmware or of the chip. Motion has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionFault {
    /// A motor does not stand where its block ends.
    Miscount(Miscount),
    /// A step was planned nearer to the one before than the drivers or the step interrupt allow.
    StepsTooNear,
    /// The step interrupt has missed this many updates of its timer within a few milliseconds.
    MissedUpdates(u32),
}

/// A motor that does not stand where its block ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Miscount {
    /// The motor: X, Y, Z (CoreXY: A, B, Z), extruder.
    pub motor: usize,
    /// Where it stands, steps.
    pub counted: i64,
    /// Where the block ends, steps.
    pub expected: i64,
}

impl Miscount {
    /// The first motor that does not stand where it must; `None` if all do.
    pub fn between(counted: [i64; 4], expected: [i64; 4]) -> Option<Self> {
        let motors = counted.into_iter().zip(expected).enumerate();
        let mut wrong = motors.filter(|(_, (counted, expected))| counted != expected);
        wrong.next().map(|(motor, (counted, expected))| Self { motor, counted, expected })
    }
}

/// How a move towards a sensor ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomingOutcome {
    /// The sensor triggered; the motors stand there.
    Triggered,
    /// The move ended without it.
    Missed,
}
