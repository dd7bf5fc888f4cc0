//! A step trace against the G-code and the profile it came from.
//!
//! Four things are checked: the digests are computed again; at each end of a move every motor must
//! be exactly at the position of the definitions; within a block no motor may leave the time law of
//! the reference plan by more than a step; and events keep their distance and axes their limits, in
//! corners as well.
//!
//! A block is the part between two ends of moves. If it is not one straight move (an arc, a
//! firmware retraction), its end position is checked, but not its law.

mod axis_limits;
mod corners;
mod deviation;
mod digest;
mod extrusion;
mod law;
mod path_error;
mod report;
#[cfg(test)]
mod synthetic;
#[cfg(test)]
mod tests;

pub use corners::Jumps;
pub use deviation::Deviation;
pub use digest::Fnv1a64;
pub use extrusion::{Distances, Extrusion, Slave};
pub use report::{DurationDifference, Finding, MOTOR_NAMES, TraceReport};

use crate::reference::{
    InterpretError, InterpretOptions, Job, Limits, MotorScale, Move, MoveKind, Plan, ReferenceProfile, interpret, plan,
};
use crate::trace::{Record, StepEvent, TraceError, TraceHeader, TraceReader};
use axis_limits::{AxisLimits, Excess};
use corners::{Corners, Traced};
use law::{MotorEvent, TracedBlock, keep_larger};
use path_error::PlaneScale;
use std::fmt;
use std::io::Read;
use std::num::NonZeroUsize;

/// Durations are compared for moves of at least this length, mm.
const DURATION_LENGTH_MM: f64 = 1.0;

/// Differences in duration below this many ticks are rounding.
const DURATION_SLACK_TICKS: f64 = 16.0;

/// Options of the check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceCheckOptions {
    /// Moves the reference planner knows at a time; all of them if `None`.
    pub look_ahead: Option<NonZeroUsize>,
    /// Options for reading the G-code.
    pub interpret: InterpretOptions,
    /// Largest relative difference in duration of a move of 1 mm or more.
    pub duration_tolerance: f64,
    /// Maximum distance of a motor from its law beyond one step and joined events, in steps.
    pub law_tolerance_steps: f64,
    /// Maximum further distance of the two motors of X and Y, in steps: some methods step them
    /// pulse by pulse along the axes, not each by its own law.
    pub plane_tolerance_steps: f64,
    /// Maximum number of findings that the report keeps; all are counted.
    pub findings_kept: usize,
}

impl Default for TraceCheckOptions {
    fn default() -> Self {
        Self {
            look_ahead: None,
            interpret: InterpretOptions::default(),
            duration_tolerance: 0.01,
            law_tolerance_steps: 0.02,
            plane_tolerance_steps: 0.0,
            findings_kept: 40,
        }
    }
}

/// The check could not be made.
#[derive(Debug)]
pub enum TraceCheckError {
    /// The trace cannot be read.
    Trace(TraceError),
    /// The G-code cannot be interpreted.
    Interpret(InterpretError),
    /// The trace is not of four motors named x, y, z, e (or a, b, z, e).
    Axes,
    /// The trace's header contradicts the profile; the key's name.
    NotThisProfile(&'static str),
}

impl fmt::Display for TraceCheckError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Trace(error) => error.fmt(formatter),
            Self::Interpret(error) => error.fmt(formatter),
            Self::Axes => write!(
                formatter,
                "trace header: axes must be the machine's motors: x, y, z, e; CoreXY: a, b, z, e; CoreXZ: a, y, c, e"
            ),
            Self::NotThisProfile(key) => write!(formatter, "trace header: {key} is not the profile's"),
        }
    }
}

impl std::error::Error for TraceCheckError {}

/// Checks a whole trace. Findings are in the report; an error means that the trace cannot
/// be checked at all.
///
/// # Errors
/// [`TraceCheckError`] if the trace or the G-code cannot be read or the trace is of
/// another machine.
pub fn check_trace<R: Read>(
    trace: R,
    gcode: &[u8],
    profile: &ReferenceProfile,
    options: &TraceCheckOptions,
) -> Result<TraceReport, TraceCheckError> {
    let reader = TraceReader::new(trace).map_err(TraceCheckError::Trace)?;
    let motor_of_bit = motors(reader.header(), profile)?;
    let job = interpret(gcode, profile, options.interpret).map_err(TraceCheckError::Interpret)?;
    let plan = plan(&job, options.look_ahead);
    let tick_hz = reader.header().tick_hz;
    let event_interval_ticks = profile.minimum_event_interval_us * tick_hz as f64 / 1e6;
    let mut checker = Checker {
        options,
        job: &job,
        plan: &plan,
        scale: MotorScale::new(profile),
        plane: PlaneScale::new(profile),
        motor_of_bit,
        tick_hz: tick_hz as f64,
        event_interval_ticks,
        axis_limits: AxisLimits::new(profile, tick_hz, event_interval_ticks),
        corners: Corners::new(profile, tick_hz),
        limits_in_force: None,
        order_digest: Fnv1a64::default(),
        step_digest: Fnv1a64::default(),
        motors: [0; 4],
        block_start: [0; 4],
        block_start_tick: 0,
        events: Vec::new(),
        homed: false,
        next_move: 0,
        last_step_tick: None,
        report: TraceReport {
            planned_motion_time_s: plan.motion_time_s,
            jumps: corners::planned(&job, &plan),
            ..TraceReport::default()
        },
    };
    checker.choose_limits();
    for record in reader {
        checker.record(&record.map_err(TraceCheckError::Trace)?);
    }
    Ok(checker.finish())
}

/// Motor of each bit of the masks.
fn motors(header: &TraceHeader, profile: &ReferenceProfile) -> Result<[usize; 4], TraceCheckError> {
    if header.kinematics != profile.kinematics {
        return Err(TraceCheckError::NotThisProfile("kinematics"));
    }
    let (_, names) = profile.kinematics.names();
    let mut motor_of_bit = [usize::MAX; 4];
    if header.axes.len() != motor_of_bit.len() {
        return Err(TraceCheckError::Axes);
    }
    for (bit, (name, steps_per_mm)) in header.axes.iter().zip(&header.steps_per_mm).enumerate() {
        let motor = names.iter().position(|motor| name.eq_ignore_ascii_case(motor));
        let motor = motor.filter(|motor| !motor_of_bit.contains(motor)).ok_or(TraceCheckError::Axes)?;
        motor_of_bit[bit] = motor;
        let expected = profile.steps_per_mm[motor].to_f64();
        if (steps_per_mm - expected).abs() > 1e-9 * expected {
            return Err(TraceCheckError::NotThisProfile("steps_per_mm"));
        }
    }
    Ok(motor_of_bit)
}

struct Checker<'a> {
    options: &'a TraceCheckOptions,
    job: &'a Job,
    plan: &'a Plan,
    scale: MotorScale,
    plane: PlaneScale,
    motor_of_bit: [usize; 4],
    tick_hz: f64,
    event_interval_ticks: f64,
    axis_limits: AxisLimits,
    corners: Corners,
    /// The loosest of the limits that apply up to the next end of a move.
    limits_in_force: Option<Limits>,
    order_digest: Fnv1a64,
    step_digest: Fnv1a64,
    motors: [i64; 4],
    /// The motors at the last end of a move or redefinition.
    block_start: [i64; 4],
    block_start_tick: u64,
    /// Step events since then.
    events: Vec<MotorEvent>,
    /// True if positions were redefined since the last end of a move.
    homed: bool,
    /// Index in the job of the first move not yet seen to end.
    next_move: usize,
    last_step_tick: Option<u64>,
    report: TraceReport,
}

impl Checker<'_> {
    fn find(&mut self, finding: Finding) {
        self.report.finding_count += 1;
        if self.report.findings.len() < self.options.findings_kept {
            self.report.findings.push(finding);
        }
    }

    fn record(&mut self, record: &Record) {
        let (Record::Step(StepEvent { tick, .. })
        | Record::PositionsRedefined { tick, .. }
        | Record::MoveEnd { tick, .. }) = *record;
        if tick < self.report.last_tick {
            self.find(Finding::TickDecreases { tick, previous_tick: self.report.last_tick });
        }
        self.report.last_tick = tick;
        match record {
            Record::Step(event) => self.step(*event),
            Record::PositionsRedefined { tick, positions } => self.redefine(*tick, positions),
            Record::MoveEnd { tick, line } => self.end_move(*tick, *line),
        }
    }

    fn step(&mut self, event: StepEvent) {
        let StepEvent { tick, axes, directions } = event;
        self.report.step_events += 1;
        self.order_digest.write(&[axes, directions]);
        self.step_digest.write(&tick.to_le_bytes());
        self.step_digest.write(&[0, axes, directions, 0]);
        if let Some(gap_ticks) = self.last_step_tick.and_then(|last| tick.checked_sub(last)) {
            let smallest = self.report.smallest_gap_ticks.get_or_insert(gap_ticks);
            *smallest = gap_ticks.min(*smallest);
            if (gap_ticks as f64) < self.event_interval_ticks {
                self.find(Finding::EventsTooNear { tick, gap_ticks });
            }
        }
        self.last_step_tick = Some(tick);
        let mut steps = [0; 4];
        for (bit, motor) in self.motor_of_bit.into_iter().enumerate() {
            if axes >> bit & 1 == 1 {
                steps[motor] = if directions >> bit & 1 == 1 { -1 } else { 1 };
                self.motors[motor] = self.motors[motor].saturating_add(i64::from(steps[motor]));
                self.report.motor_steps[motor] += 1;
            }
        }
        self.events.push(MotorEvent { tick, steps });
        if let Some(limits) = self.limits_in_force {
            let excess = self.axis_limits.speed(tick, self.motors, &limits, &mut self.report.speed_ratio);
            if let Some(Excess { axis, tick, ratio }) = excess {
                self.find(Finding::TooFast { axis, tick, ratio });
            }
        }
    }

    fn redefine(&mut self, tick: u64, positions: &[i32]) {
        let rest = self.job.moves.get(self.next_move..).unwrap_or_default();
        let group = rest.split_inclusive(|one| one.kind.ends_with_a_record()).next().unwrap_or_default();
        let job_ends = group.len() == rest.len() && !group.last().is_some_and(|one| one.kind.ends_with_a_record());
        let expected = group.iter().any(|one| one.homing_before) || job_ends && self.job.homed_at_end;
        if !expected {
            self.find(Finding::UnexpectedHoming { tick });
        }
        for (motor, position) in self.motor_of_bit.into_iter().zip(positions) {
            self.motors[motor] = i64::from(*position);
        }
        self.homed = true;
        self.axis_limits.restart();
        self.begin_block(tick);
    }

    fn begin_block(&mut self, tick: u64) {
        self.block_start = self.motors;
        self.block_start_tick = tick;
        self.events.clear();
    }

    /// Chooses the limits for the next moves. Windows of speed do not reach over a change of
    /// limits. A retraction leaves no record, so that limits may change between two records.
    fn choose_limits(&mut self) {
        let rest = self.job.moves.get(self.next_move..).unwrap_or_default();
        let group = rest.split_inclusive(|one| one.kind.ends_with_a_record()).next().unwrap_or_default();
        let applying = group.iter().filter_map(|one| self.job.limits.get(one.limits)).copied();
        let limits = applying.reduce(Limits::loosest).or(self.limits_in_force);
        if limits != self.limits_in_force {
            self.limits_in_force = limits;
            self.axis_limits.restart();
        }
    }

    fn end_move(&mut self, tick: u64, line: u32) {
        self.report.moves += 1;
        let first = self.next_move;
        let rest = self.job.moves.get(first..).unwrap_or_default();
        let Some(count) = rest.iter().position(|one| one.kind.ends_with_a_record()) else {
            self.find(Finding::UnexpectedMoveEnd { line });
            self.begin_block(tick);
            return;
        };
        let group = &rest[..=count];
        let last = &rest[count];
        if line != last.line {
            self.find(Finding::WrongLine { line, expected: last.line });
        }
        if group.iter().any(|one| one.homing_before) && !self.homed {
            self.find(Finding::MissingHoming { line: last.line });
        }
        self.check_position(last);
        if count == 0 && last.kind == MoveKind::Line {
            self.check_corner(first, last, tick);
            self.check_block(first, last, tick);
        } else {
            self.corners.forget();
        }
        self.next_move = first + count + 1;
        self.homed = false;
        self.choose_limits();
        self.begin_block(tick);
    }

    fn check_corner(&mut self, index: usize, one: &Move, end_tick: u64) {
        let (Some(planned), Some(limits)) = (self.plan.moves.get(index), self.job.limits.get(one.limits)) else {
            return;
        };
        if one.stop_before {
            self.corners.forget();
        }
        let traced = Traced {
            one,
            acceleration_mm_per_s2: planned.law.acceleration_mm_per_s2,
            ticks: [self.block_start_tick.min(end_tick), end_tick],
            events: &self.events,
            limits_mm_per_s: limits.corner_velocity_mm_per_s,
        };
        for too_large in self.corners.pass(&traced) {
            self.find(Finding::JumpsTooFar { line: one.line, jump: too_large });
        }
    }

    fn check_position(&mut self, one: &Move) {
        let [x, y, z] = self.scale.motors(one.end_10nm);
        let expected = [x, y, z, self.scale.extruder(one.extruder_end).rounded];
        for (motor, (position, expected)) in self.motors.into_iter().zip(expected).enumerate() {
            if position != expected {
                self.find(Finding::WrongPosition { line: one.line, motor, position, expected });
            }
        }
    }

    fn check_block(&mut self, index: usize, one: &Move, end_tick: u64) {
        let Some(planned) = self.plan.moves.get(index) else { return };
        let measured_ticks = end_tick.saturating_sub(self.block_start_tick);
        let planned_ticks = planned.law.duration_s() * self.tick_hz;
        self.report.laws_checked += 1;
        self.report.measured_s += measured_ticks as f64 / self.tick_hz;
        self.report.planned_s += planned.law.duration_s();
        if planned.law.length_mm >= DURATION_LENGTH_MM {
            let relative = measured_ticks as f64 / planned_ticks - 1.0;
            let difference = DurationDifference { relative, measured_ticks, planned_ticks, line: one.line };
            if (measured_ticks as f64 - planned_ticks).abs() > DURATION_SLACK_TICKS {
                if self.report.largest_duration_difference.is_none_or(|most| relative.abs() > most.relative.abs()) {
                    self.report.largest_duration_difference = Some(difference);
                }
                if relative.abs() > self.options.duration_tolerance {
                    self.find(Finding::WrongDuration(difference));
                }
            }
        }
        if measured_ticks == 0 {
            return;
        }
        // X, Y, Z blocks are made of whole steps; the extruder keeps its fraction
        // from block to block.
        let mut ideal_start = self.block_start.map(|steps| steps as f64);
        let mut ideal_end = self.motors.map(|steps| steps as f64);
        ideal_start[3] = self.scale.extruder(one.extruder_start).exact;
        ideal_end[3] = self.scale.extruder(one.extruder_end).exact;
        let events = std::mem::take(&mut self.events);
        let other = 1.0 + self.options.law_tolerance_steps;
        let plane = other + self.options.plane_tolerance_steps;
        let block = TracedBlock {
            line: one.line,
            start_tick: self.block_start_tick,
            end_tick,
            start: self.block_start,
            ideal_start,
            ideal_end,
            events: &events,
            law: &planned.law,
            event_interval_ticks: self.event_interval_ticks,
            tolerance_steps: [plane, plane, other, other],
        };
        self.report.extrusion.block(&block);
        for (motor, deviation) in block.deviations().into_iter().enumerate() {
            let Some(deviation) = deviation else { continue };
            keep_larger(&mut self.report.largest_deviation[motor], deviation);
            if deviation.excess_steps() > 0.0 {
                self.find(Finding::OffTheLaw { motor, deviation });
            }
        }
        if let Some(limits) = self.job.limits.get(one.limits) {
            let ratios = &mut self.report.acceleration_ratio;
            if let Some(Excess { axis, tick, ratio }) =
                self.axis_limits.acceleration(self.block_start, &events, limits, ratios)
            {
                self.find(Finding::TooMuchAcceleration { axis, tick, ratio });
            }
        }
        if let Some(error_mm) = self.plane.largest_error_mm(self.block_start, self.motors, &events) {
            self.report.largest_path_error_mm = self.report.largest_path_error_mm.max(error_mm);
        }
        // Give the allocation back for the next block.
        self.events = events;
    }

    fn finish(mut self) -> TraceReport {
        let rest = self.job.moves.get(self.next_move..).unwrap_or_default();
        let missing = rest.iter().filter(|one| one.kind.ends_with_a_record()).count();
        if missing > 0 {
            self.find(Finding::MissingMoves { count: missing });
        } else if let Some(last) = rest.last()
            && !self.job.homed_at_end
        {
            self.check_position(last);
        }
        self.report.order_digest = self.order_digest.0;
        self.report.step_digest = self.step_digest.0;
        self.report
    }
}
