//! Prepared jobs (GPRE): where one begins, and how its moves enter the motion.

/// Motion of a prepared job in another encoding than the compact one: its request to the planner,
/// and the values that the printer checks and counts.
#[derive(Clone, Copy, Debug)]
pub struct OtherMotion<R> {
    /// The request to the planner.
    pub request: R,
    /// Source line.
    pub line: u32,
    /// End of X, Y and Z, machine coordinates in units of 10 nm.
    pub end_10nm: [i64; 3],
    /// Maximum distance of the end from there, units of 10 nm: a format of motor steps has no
    /// finer positions.
    pub tolerance_10nm: [i64; 3],
    /// Filament, units of 0.1 nm.
    pub filament_100pm: i64,
    /// Number of the G-code's moves that end in it.
    pub moves: u32,
}

/// Position of the machine, units of 10 nm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PreparedPlace {
    /// Machine position.
    pub position_10nm: [i64; 3],
    /// The part of Z that is the lift of a firmware retraction.
    pub lift_10nm: i64,
    /// E of the G-code.
    pub extruder_10nm: i64,
}
