//! The report of a check.

use super::corners::{Jumps, TooLarge};
use super::deviation::Deviation;
use super::extrusion::Extrusion;
use std::fmt;

/// Names of the motors in reports; A and B of CoreXY are listed under x and y.
pub const MOTOR_NAMES: [&str; 4] = ["x", "y", "z", "e"];

/// A move that takes another time than planned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DurationDifference {
    /// (measured - planned) / planned.
    pub relative: f64,
    /// Ticks measured.
    pub measured_ticks: u64,
    /// Ticks planned.
    pub planned_ticks: f64,
    /// The move's source line.
    pub line: u32,
}

/// A violation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finding {
    /// A record is earlier than the one before.
    TickDecreases {
        /// Tick of the record.
        tick: u64,
        /// The tick before.
        previous_tick: u64,
    },
    /// Two step events are too near to each other.
    EventsTooNear {
        /// Tick of the later event.
        tick: u64,
        /// Ticks between them.
        gap_ticks: u64,
    },
    /// A move ends with another line than the next move of the job has.
    WrongLine {
        /// The line in the trace.
        line: u32,
        /// The line of the job's next move.
        expected: u32,
    },
    /// A move ends after the job's last.
    UnexpectedMoveEnd {
        /// The line in the trace.
        line: u32,
    },
    /// Moves of the job are not in the trace.
    MissingMoves {
        /// Number of these.
        count: usize,
    },
    /// Positions are redefined where the job homes no axis.
    UnexpectedHoming {
        /// The record's tick.
        tick: u64,
    },
    /// The job homes, the trace does not.
    MissingHoming {
        /// Line of the move after it.
        line: u32,
    },
    /// A motor is at a wrong position at a move's end.
    WrongPosition {
        /// The move's source line.
        line: u32,
        /// Index in [`MOTOR_NAMES`].
        motor: usize,
        /// Position, in steps.
        position: i64,
        /// The position that is expected, in steps.
        expected: i64,
    },
    /// A motor leaves the time law.
    OffTheLaw {
        /// Index in [`MOTOR_NAMES`].
        motor: usize,
        /// The deviation, with its place.
        deviation: Deviation,
    },
    /// A move takes another time than planned.
    WrongDuration(DurationDifference),
    /// An axis is faster than it may be.
    TooFast {
        /// Index of the axis.
        axis: usize,
        /// Tick at the window's end.
        tick: u64,
        /// Minimum possible speed / limit.
        ratio: f64,
    },
    /// The speed of an axis jumps too far at the start of a move.
    JumpsTooFar {
        /// The move's source line.
        line: u32,
        /// The axis, and its jump.
        jump: TooLarge,
    },
    /// An axis changes its speed faster than it may.
    TooMuchAcceleration {
        /// Index of the axis.
        axis: usize,
        /// Tick at the window's end.
        tick: u64,
        /// Minimum possible acceleration / limit.
        ratio: f64,
    },
}

/// The result of a check.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TraceReport {
    /// Records of kind 0.
    pub step_events: u64,
    /// Steps of each motor, both directions.
    pub motor_steps: [u64; 4],
    /// Records of kind 2.
    pub moves: u64,
    /// Moves whose steps were compared with their time law.
    pub laws_checked: u64,
    /// FNV-1a-64 over (axes, directions) of the step events.
    pub order_digest: u64,
    /// FNV-1a-64 over the step events' whole records.
    pub step_digest: u64,
    /// Tick of the last record.
    pub last_tick: u64,
    /// Duration of the moves whose laws were checked, as measured, s.
    pub measured_s: f64,
    /// Duration of the same moves by the reference plan, s.
    pub planned_s: f64,
    /// Motion time of the whole job by the reference plan, s.
    pub planned_motion_time_s: f64,
    /// Largest deviation of each motor from the law, by its excess over what is allowed.
    pub largest_deviation: [Option<Deviation>; 4],
    /// The extruder, and one that steps with the leading motor, in the moves whose law was checked.
    pub extrusion: Extrusion,
    /// Largest distance in X and Y from the straight line of a move whose law was checked, between
    /// the steps at which it starts and ends, mm.
    pub largest_path_error_mm: f64,
    /// The largest relative difference in duration among moves of at least 1 mm.
    pub largest_duration_difference: Option<DurationDifference>,
    /// Ticks between the two step events that are nearest to each other.
    pub smallest_gap_ticks: Option<u64>,
    /// Jumps of each axis' speed at corners.
    pub jumps: [Jumps; 4],
    /// Largest least-possible speed of each axis over a window / limit.
    pub speed_ratio: [f64; 4],
    /// Largest least-possible acceleration of each axis over a window / limit.
    pub acceleration_ratio: [f64; 4],
    /// Number of findings.
    pub finding_count: u64,
    /// The first findings.
    pub findings: Vec<Finding>,
}

impl TraceReport {
    /// Returns true if the report is free of findings.
    pub fn passed(&self) -> bool {
        self.finding_count == 0
    }

    /// The digest as `print --json` writes it.
    pub fn order_digest_hex(&self) -> String {
        format!("{:016x}", self.order_digest)
    }

    /// The digest as `print --json` writes it.
    pub fn step_digest_hex(&self) -> String {
        format!("{:016x}", self.step_digest)
    }
}

fn name(index: usize) -> &'static str {
    MOTOR_NAMES.get(index).copied().unwrap_or("?")
}

impl fmt::Display for DurationDifference {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { relative, measured_ticks, planned_ticks, line } = self;
        write!(
            formatter,
            "line {line} takes {measured_ticks} ticks, planned {planned_ticks:.1} ({:+.4} %)",
            relative * 100.0
        )
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TickDecreases { tick, previous_tick } => write!(formatter, "tick {tick} follows {previous_tick}"),
            Self::EventsTooNear { tick, gap_ticks } => {
                write!(formatter, "step event at tick {tick} only {gap_ticks} ticks after the one before")
            }
            Self::WrongLine { line, expected } => write!(formatter, "line {line} ends where line {expected} should"),
            Self::UnexpectedMoveEnd { line } => write!(formatter, "line {line} ends after the job's last move"),
            Self::MissingMoves { count } => write!(formatter, "{count} moves are missing at the end"),
            Self::UnexpectedHoming { tick } => write!(formatter, "positions redefined at tick {tick} without homing"),
            Self::MissingHoming { line } => {
                write!(formatter, "no positions redefined by the homing before line {line}")
            }
            Self::WrongPosition { line, motor, position, expected } => {
                write!(formatter, "motor {} at {position} after line {line}, should be {expected}", name(*motor))
            }
            Self::OffTheLaw { motor, deviation } => write!(formatter, "motor {} {deviation}", name(*motor)),
            Self::WrongDuration(difference) => difference.fmt(formatter),
            Self::TooFast { axis, tick, ratio } => {
                write!(formatter, "axis {} at {ratio:.4} of its speed limit before tick {tick}", name(*axis))
            }
            Self::JumpsTooFar { line, jump: TooLarge { axis, least_mm_per_s, limit_mm_per_s } } => {
                let name = name(*axis);
                write!(
                    formatter,
                    "axis {name} jumps by {least_mm_per_s:.2} mm/s before line {line}, limit {limit_mm_per_s}"
                )
            }
            Self::TooMuchAcceleration { axis, tick, ratio } => {
                write!(formatter, "axis {} at {ratio:.4} of its acceleration limit before tick {tick}", name(*axis))
            }
        }
    }
}

impl fmt::Display for TraceReport {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z, e] = self.motor_steps;
        writeln!(formatter, "step events        {}", self.step_events)?;
        writeln!(formatter, "motor steps        x {x}, y {y}, z {z}, e {e}")?;
        writeln!(formatter, "moves              {}, {} held against their law", self.moves, self.laws_checked)?;
        writeln!(formatter, "order digest       {}", self.order_digest_hex())?;
        writeln!(formatter, "step digest        {}", self.step_digest_hex())?;
        writeln!(formatter, "last tick          {}", self.last_tick)?;
        writeln!(formatter, "these moves        {:.4} s, planned {:.4} s", self.measured_s, self.planned_s)?;
        writeln!(formatter, "whole job planned  {:.4} s", self.planned_motion_time_s)?;
        if let Some(difference) = &self.largest_duration_difference {
            writeln!(formatter, "largest difference {difference}")?;
        }
        if let Some(gap) = self.smallest_gap_ticks {
            writeln!(formatter, "nearest events     {gap} ticks")?;
        }
        for (motor, deviation) in self.largest_deviation.iter().enumerate() {
            if let Some(deviation) = deviation {
                writeln!(formatter, "motor {}            {deviation}", name(motor))?;
            }
        }
        if self.extrusion.blocks > 0 {
            write!(formatter, "{}", self.extrusion)?;
        }
        writeln!(formatter, "path error         {:.4} mm", self.largest_path_error_mm)?;
        let ratios = self.speed_ratio.iter().zip(&self.acceleration_ratio).enumerate();
        for (axis, (speed, acceleration)) in ratios {
            let name = name(axis);
            writeln!(
                formatter,
                "axis {name}             speed {speed:.4}, acceleration {acceleration:.4} of its limits"
            )?;
        }
        for (axis, jumps) in self.jumps.iter().enumerate() {
            let (name, Jumps { p99_mm_per_s, largest_mm_per_s }) = (name(axis), jumps);
            writeln!(formatter, "corners {name}          {p99_mm_per_s:.3} (p99), {largest_mm_per_s:.3} mm/s at most")?;
        }
        writeln!(formatter, "findings           {}", self.finding_count)?;
        for finding in &self.findings {
            writeln!(formatter, "  {finding}")?;
        }
        Ok(())
    }
}
