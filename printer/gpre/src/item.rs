//! The items of a job.

pub use ferrostep_planner::look_ahead::EntrySpeed;
pub use ferrostep_planner::{Coordinate, PreparedMove, SquaredSpeed};

/// A part of a job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Item<'a> {
    /// A move.
    Move(&'a PreparedMove),
    /// The fan changes with the motion before it, 0 to 255.
    Fan {
        /// Number of the source line.
        line: u32,
        /// Power.
        power: u8,
    },
    /// Anything else: a command as the G-code has it, without its comment.
    Command {
        /// Number of the source line.
        line: u32,
        /// The command.
        text: &'a str,
    },
}

/// Limits of the machine as M201, M203, M204 and M205 set them, mm and s: largest feeds and
/// accelerations of X, Y, Z and the filament, accelerations of printing, travel and retraction,
/// junction deviation, and instantaneous corner velocities of X, Y, Z and the filament.
pub type LimitValues = [f32; 16];

/// Index in [`LimitValues`] of the first instantaneous corner velocity; these may be infinite.
pub(crate) const FIRST_CORNER_VALUE: usize = 12;

/// The settings in force from move to move: with them a job can be entered at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModalState {
    /// Target of the nozzle, degrees Celsius; 0 = off.
    pub nozzle_celsius: u16,
    /// Target of the bed, degrees Celsius; 0 = off.
    pub bed_celsius: u16,
    /// Feed in percent (M220) that the moves were planned with.
    pub feed_percent: u16,
    /// Flow in percent (M221) that their filament includes.
    pub flow_percent: u16,
    /// E as the G-code sees it, units of 10 nm.
    pub extruder_10nm: i64,
    /// The G-code's coordinates of X, Y and Z minus the machine's (G92), units of 10 nm.
    pub offset_10nm: [i64; 3],
    /// Lift of Z by a firmware retraction, units of 10 nm: the moves' Z includes it, the
    /// G-code's does not.
    pub lift_10nm: i64,
    /// The limits, if they differ from the profile's.
    pub limits: Option<LimitValues>,
}

impl ModalState {
    /// State of a machine that has just been switched on.
    pub const START: Self = Self {
        nozzle_celsius: 0,
        bed_celsius: 0,
        feed_percent: 100,
        flow_percent: 100,
        extruder_10nm: 0,
        offset_10nm: [0; 3],
        lift_10nm: 0,
        limits: None,
    };
}
