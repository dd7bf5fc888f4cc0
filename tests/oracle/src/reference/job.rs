//! The interpreter's result for the planner: moves with exact ends.

use super::profile::Acceleration;

/// The extruder's total is kept in hundredths of a unit of 10 nm, so that a flow factor in whole
/// percent stays exact.
pub const EXTRUDER_FRACTIONS_PER_UNIT: i128 = 100;

/// Limits of speed and acceleration in force for a move. Axes are in the order x, y, z, e.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest speed of each axis, mm/s.
    pub max_feed_mm_per_s: [f64; 4],
    /// Largest acceleration of each axis, mm/s^2.
    pub max_acceleration_mm_per_s2: [f64; 4],
    /// Acceleration along the path by the kind of move, mm/s^2.
    pub acceleration_mm_per_s2: Acceleration,
    /// Yu's delta, mm.
    pub junction_deviation_mm: f64,
    /// Maximum jump of the speed of each axis at a corner, mm/s; infinity for no limit.
    pub corner_velocity_mm_per_s: [f64; 4],
}

impl Limits {
    /// Returns these limits with each axis' larger limit of speed, acceleration and corner
    /// speed of the two.
    pub fn loosest(mut self, other: Self) -> Self {
        let of_axes = [
            (&mut self.max_feed_mm_per_s, other.max_feed_mm_per_s),
            (&mut self.max_acceleration_mm_per_s2, other.max_acceleration_mm_per_s2),
            (&mut self.corner_velocity_mm_per_s, other.corner_velocity_mm_per_s),
        ];
        for (limits, others) in of_axes {
            for (limit, other) in limits.iter_mut().zip(others) {
                *limit = limit.max(other);
            }
        }
        self
    }
}

/// Origin of a move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MoveKind {
    /// A G0 or G1: one block, ended by a record in the trace.
    Line,
    /// One chord of a G2 or G3; only the last chord is ended by a record.
    ArcChord {
        /// True for the arc's last chord.
        last: bool,
    },
    /// A part of G10 or G11; it leaves no record.
    FirmwareRetraction,
}

impl MoveKind {
    /// Returns true if the trace holds an end-of-move record after this move.
    pub fn ends_with_a_record(self) -> bool {
        matches!(self, Self::Line | Self::ArcChord { last: true })
    }
}

/// One straight piece of motion in machine coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Number of the source line, from 1.
    pub line: u32,
    /// Origin of the move.
    pub kind: MoveKind,
    /// Start of X, Y, Z, in units of 10 nm.
    pub start_10nm: [i64; 3],
    /// End of X, Y, Z, in units of 10 nm.
    pub end_10nm: [i64; 3],
    /// The extruder's total before the move, flow applied, in
    /// 1/[`EXTRUDER_FRACTIONS_PER_UNIT`] of 10 nm.
    pub extruder_start: i128,
    /// The extruder's total after the move.
    pub extruder_end: i128,
    /// Speed asked for along the path, mm/s, the feed factor applied.
    pub feed_mm_per_s: f64,
    /// Index of its limits in [`Job::limits`].
    pub limits: usize,
    /// True if motion must have stopped before this move.
    pub stop_before: bool,
    /// True if axes were homed between the move before and this one.
    pub homing_before: bool,
}

/// A whole job, interpreted.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Moves, in order.
    pub moves: Vec<Move>,
    /// The sets of limits its moves refer to; never empty.
    pub limits: Vec<Limits>,
    /// Lines in the text.
    pub lines: u32,
    /// G0-G3 whose target (or, on an arc, any point) a soft limit moved.
    pub clamped_moves: u32,
    /// True if axes were homed after the last move.
    pub homed_at_end: bool,
    /// X, Y, Z and E after the last line as the G-code itself counts them, in units of 10 nm.
    pub logical_end_10nm: [i64; 4],
}

impl Job {
    /// A job without lines, on a machine with these limits.
    pub(super) fn new(limits: Limits) -> Self {
        Self {
            moves: Vec::new(),
            limits: vec![limits],
            lines: 0,
            clamped_moves: 0,
            homed_at_end: false,
            logical_end_10nm: [0; 4],
        }
    }

    /// G0-G3 that displace something: the number of end-of-move records a trace of this job has.
    pub fn move_count(&self) -> usize {
        self.moves.iter().filter(|one| one.kind.ends_with_a_record()).count()
    }

    /// Net filament in mm, flow applied.
    pub fn filament_mm(&self) -> f64 {
        let total = self.moves.last().map_or(0, |one| one.extruder_end);
        total as f64 / (EXTRUDER_FRACTIONS_PER_UNIT as f64 * super::UNITS_PER_MM as f64)
    }
}
