//! The counts of a print.

use ferrostep_planner::{StepDigests, TICKS_PER_SECOND};

/// The counts of a print.
#[derive(Clone, Copy, Debug)]
pub struct Figures {
    /// Virtual time from the start to the last step, s.
    pub print_time_s: f64,
    /// Sum of the durations of all blocks, homing left out, s.
    pub motion_time_s: f64,
    /// Steps issued, both directions.
    pub motor_steps: [u64; 4],
    /// Maximum number of events in any millisecond, times 1000.
    pub max_event_rate_hz: u64,
    /// Times the step queue was empty at non-zero speed.
    pub underruns: u64,
    /// Times a block left the look-ahead ring early because steps ran out.
    pub starvation_flushes: u64,
    /// Moves planned slower than asked for, because a board could not keep up with them.
    pub slowed_moves: u64,
    /// Moves that became one block with the one before.
    pub merged_moves: u64,
    /// Digests of all step events.
    pub digests: StepDigests,
}

/// Ticks in seconds.
pub fn seconds(ticks: u64) -> f64 {
    ticks as f64 / f64::from(TICKS_PER_SECOND)
}
