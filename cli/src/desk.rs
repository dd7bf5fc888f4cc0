//! A printer's motion on the desk: made step by step, or only planned.

mod drivers;
mod heat;
mod heat_at_rest;
mod plan_reader;
mod rehearsal;
mod step_queue;

pub use drivers::DeskDrivers;
pub use heat::{DeskHeat, DeskHeating};
pub use plan_reader::{PlanReader, PlannedMotion};
pub use rehearsal::{DeskMachine, Rehearsal};
pub use step_queue::VirtualStepQueue;

use ferrostep_planner::{StepDigests, TICKS_PER_SECOND};
use ferrostep_printer::{Motion, Signals};

/// Blocks in the look-ahead ring, as on the target.
pub const LOOK_AHEAD_BLOCKS: usize = 128;

/// Mask of all motors.
const ALL_MOTORS: u8 = 0b1111;

/// Motion of a session, in virtual time.
pub trait Desk {
    /// What commands move.
    type Motion<'a>: Motion
    where
        Self: 'a;

    /// Whether it makes every step. If not, it is an estimate, whose cost must not follow the print's time.
    const MAKES_STEPS: bool;

    /// The motion, as commands see it; a halt ends their waits.
    fn motion<'a>(&'a self, signals: &'a Signals) -> Self::Motion<'a>;
    /// If a command waits for motion: lets time pass until there is something new, or for a while.
    fn pass_motion(&self);
    /// The motion clock: ticks of all motion so far. It stands still between motions.
    fn tick(&self) -> u64;
    /// Stops motion at once.
    fn stop(&self);
    /// Power of the part-cooling fan at the present point of the motion, 0 to 255.
    fn fan_power(&self) -> u8;
    /// Mask of the motors that have current.
    fn enabled_motors(&self) -> u8;
    /// For comparison: see [`ferrostep_planner::Planner::plan_block_by_block`].
    fn plan_block_by_block(&self) -> bool;
    /// What was done so far, without the print's time.
    fn figures(&self) -> Figures;
}

/// What a print did, in numbers.
#[derive(Clone, Copy, Debug)]
pub struct Figures {
    /// Virtual time from the start to the last step, s.
    pub print_time_s: f64,
    /// Sum of the durations of all blocks, homing left out, s.
    pub motion_time_s: f64,
    /// Steps issued, both directions.
    pub motor_steps: [u64; 4],
    /// Most events in any millisecond, times 1000.
    pub max_event_rate_hz: u64,
    /// How often the step queue was empty at non-zero speed.
    pub underruns: u64,
    /// How often a block left the look-ahead ring because steps ran out.
    pub starvation_flushes: u64,
    /// Moves planned slower than asked for, because a board could not keep up with them.
    pub slowed_moves: u64,
    /// Moves that became one block with the one before.
    pub merged_moves: u64,
    /// Digests of all step events.
    pub digests: StepDigests,
}

/// Ticks in seconds.
fn seconds(ticks: u64) -> f64 {
    ticks as f64 / f64::from(TICKS_PER_SECOND)
}
