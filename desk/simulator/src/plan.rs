//! Represents a plan as laws of the axes and the filament, and simulates it: position as a function
//! of time, without steps.

mod extruder;

pub use extruder::ExtruderFilter;
pub(crate) use extruder::ExtruderSamples;

use crate::frame::{Frame, FrameError, FrameSettings};
use crate::law::{Law, Piece, ShapedCursor, ShapedLaw};
use crate::measures::{Measures, SAMPLE_S, STOP_S, Sample};
use crate::motion::Motion;
use crate::nozzle::{Nozzle, NozzleError, NozzleSettings};
use crate::path::PathSegment;
use crate::shapers::Shaper;
use ferrostep_oracle::reference::{EXTRUDER_FRACTIONS_PER_UNIT, Job, Move, Trapezoid, UNITS_PER_MM};
use std::fmt;

/// Time simulated before a plan's start and after its end, s: shapers look ahead, and the ringing
/// afterwards must be covered.
const MARGIN_S: f64 = 0.3;

/// Speeds of a move along its path, or along the filament if only that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoveSpeeds {
    /// Speed at the start, mm/s.
    pub entry_mm_per_s: f64,
    /// Cruise speed, mm/s.
    pub cruise_mm_per_s: f64,
    /// Speed at the end, mm/s.
    pub exit_mm_per_s: f64,
    /// Magnitude of the acceleration of both ramps, mm/s^2.
    pub acceleration_mm_per_s2: f64,
}

impl From<Trapezoid> for MoveSpeeds {
    fn from(law: Trapezoid) -> Self {
        Self {
            entry_mm_per_s: law.entry_mm_per_s,
            cruise_mm_per_s: law.peak_mm_per_s,
            exit_mm_per_s: law.exit_mm_per_s,
            acceleration_mm_per_s2: law.acceleration_mm_per_s2,
        }
    }
}

/// Geometry of a move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoveShape {
    /// Displacement of X, Y, Z, mm.
    pub axes_mm: [f64; 3],
    /// Filament fed, mm; negative when it is retracted.
    pub filament_mm: f64,
    /// Length along which the speeds are measured, mm.
    pub length_mm: f64,
}

impl MoveShape {
    /// Returns the shape of a move of the oracle.
    pub fn of(one: &Move) -> Self {
        let mm = |units: i64| units as f64 / UNITS_PER_MM as f64;
        let axes_mm = [0, 1, 2].map(|axis: usize| mm(one.end_10nm[axis] - one.start_10nm[axis]));
        let unit = EXTRUDER_FRACTIONS_PER_UNIT as f64 * UNITS_PER_MM as f64;
        Self::new(axes_mm, (one.extruder_end - one.extruder_start) as f64 / unit)
    }

    /// Creates the shape of a displacement of X, Y, Z with this filament, mm.
    pub fn new(axes_mm: [f64; 3], filament_mm: f64) -> Self {
        let path_mm = axes_mm.iter().map(|travel| travel * travel).sum::<f64>().sqrt();
        let length_mm = if path_mm == 0.0 { filament_mm.abs() } else { path_mm };
        Self { axes_mm, filament_mm, length_mm }
    }

    /// Returns the cross-section of the printed line, mm^2; 0 on a travel.
    pub fn bead_mm2(&self, filament_mm2: f64) -> f64 {
        let [x, y, _] = self.axes_mm;
        let plane_mm = x.hypot(y);
        if self.filament_mm > 0.0 && plane_mm > 0.0 { self.filament_mm / plane_mm * filament_mm2 } else { 0.0 }
    }
}

/// Laws of motion of a job, or of the part of it between two homings.
#[derive(Clone, Debug)]
pub struct Plan {
    x: Law,
    y: Law,
    z: Law,
    filament: Law,
    /// True for each piece to which pressure advance applies.
    advances: Vec<bool>,
    path: Vec<PathSegment>,
    ends: Vec<MoveEnd>,
}

/// End of a move that a trace records.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MoveEnd {
    pub time_s: f64,
    /// Line of the move in the G-code.
    pub line: u32,
}

impl Plan {
    /// Builds the plans of a job whose moves have these speeds: one, and another after each homing
    /// within the job.
    pub fn of_job(job: &Job, speeds: &[MoveSpeeds], filament_mm2: f64) -> Vec<Self> {
        let mut plans = Vec::new();
        let mut builder = PlanBuilder::new(filament_mm2);
        for (one, speeds) in job.moves.iter().zip(speeds) {
            if one.homing_before {
                plans.extend(std::mem::replace(&mut builder, PlanBuilder::new(filament_mm2)).build());
            }
            builder.push(&ExecutedMove::of(one, speeds));
        }
        plans.extend(builder.build());
        plans
    }

    /// Returns the plan's duration, s.
    pub fn duration_s(&self) -> f64 {
        let [start_s, end_s] = self.x.ends_s();
        end_s - start_s
    }

    /// Returns the laws of X and Y.
    pub const fn laws(&self) -> [&Law; 2] {
        [&self.x, &self.y]
    }

    /// Returns the law of the filament.
    pub const fn filament(&self) -> &Law {
        &self.filament
    }

    /// Returns the laws of X, Y and Z.
    pub(crate) const fn axes(&self) -> [&Law; 3] {
        [&self.x, &self.y, &self.z]
    }

    /// Returns the law of the filament with pressure advance.
    pub(crate) fn advanced_filament(&self, advance_s: f64) -> Law {
        self.filament.advanced(advance_s, |index| self.advances[index])
    }

    /// Returns the ends of the moves, in order.
    pub(crate) fn ends(&self) -> &[MoveEnd] {
        &self.ends
    }

    /// Returns the path in X and Y.
    pub fn path(&self) -> &[PathSegment] {
        &self.path
    }
}

/// Straight move as it is executed: its speed along the path at the start, and its accelerations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExecutedMove {
    /// Line of the move in the G-code, if a trace records its end.
    pub recorded_line: Option<u32>,
    /// Start position of X, Y, Z and the filament, mm.
    pub start_mm: [f64; 4],
    /// Geometry of the move.
    pub shape: MoveShape,
    /// Speed at the start, mm/s.
    pub entry_mm_per_s: f64,
    /// Duration, s, and acceleration, mm/s^2, of each phase; phases without duration are skipped.
    pub phases: [(f64, f64); 3],
}

impl ExecutedMove {
    /// Creates a move of a job with these speeds.
    fn of(one: &Move, speeds: &MoveSpeeds) -> Self {
        let shape = MoveShape::of(one);
        let unit = EXTRUDER_FRACTIONS_PER_UNIT as f64 * UNITS_PER_MM as f64;
        let [x, y, z] = one.start_10nm.map(|units| units as f64 / UNITS_PER_MM as f64);
        Self {
            recorded_line: one.kind.ends_with_a_record().then_some(one.line),
            start_mm: [x, y, z, one.extruder_start as f64 / unit],
            shape,
            entry_mm_per_s: speeds.entry_mm_per_s,
            phases: phases(speeds, shape.length_mm),
        }
    }
}

/// Builds a plan move by move.
#[derive(Debug)]
pub struct PlanBuilder {
    filament_mm2: f64,
    time_s: f64,
    /// Pieces of X, Y, Z and the filament.
    pieces: [Vec<Piece>; 4],
    advances: Vec<bool>,
    path: Vec<PathSegment>,
    ends: Vec<MoveEnd>,
}

impl PlanBuilder {
    /// Creates a plan without moves, for filament of this cross-section, mm^2.
    pub fn new(filament_mm2: f64) -> Self {
        Self {
            filament_mm2,
            time_s: 0.0,
            pieces: Default::default(),
            advances: Vec::new(),
            path: Vec::new(),
            ends: Vec::new(),
        }
    }

    /// Appends a move, which begins where the previous one ends.
    pub fn push(&mut self, one: &ExecutedMove) {
        let ExecutedMove { recorded_line, start_mm, shape, entry_mm_per_s, phases } = *one;
        let [x, y, z] = shape.axes_mm;
        let shares = [x, y, z, shape.filament_mm].map(|travel| travel / shape.length_mm);
        let bead_mm2 = shape.bead_mm2(self.filament_mm2);
        let start_s = self.time_s;
        let mut along = Motion { position_mm: 0.0, speed_mm_per_s: entry_mm_per_s, acceleration_mm_per_s2: 0.0 };
        for (duration_s, acceleration_mm_per_s2) in phases {
            if duration_s <= MIN_PHASE_S {
                continue;
            }
            along.acceleration_mm_per_s2 = acceleration_mm_per_s2;
            for ((pieces, share), start_mm) in self.pieces.iter_mut().zip(shares).zip(start_mm) {
                let motion = Motion {
                    position_mm: start_mm + share * along.position_mm,
                    speed_mm_per_s: share * along.speed_mm_per_s,
                    acceleration_mm_per_s2: share * acceleration_mm_per_s2,
                };
                pieces.push(Piece { start_s: self.time_s, duration_s, motion });
            }
            self.advances.push(bead_mm2 > 0.0);
            along = along.after(duration_s);
            self.time_s += duration_s;
        }
        if x != 0.0 || y != 0.0 {
            let [x_mm, y_mm, ..] = start_mm;
            let (from_mm, to_mm) = ([x_mm, y_mm], [x_mm + x, y_mm + y]);
            self.path.push(PathSegment { start_s, end_s: self.time_s, from_mm, to_mm, bead_mm2 });
        }
        if let Some(line) = recorded_line {
            self.ends.push(MoveEnd { time_s: self.time_s, line });
        }
    }

    /// Builds the plan; `None` if nothing moves.
    pub fn build(self) -> Option<Plan> {
        let Self { advances, path, ends, .. } = self;
        let [x, y, z, filament] = self.pieces.map(|pieces| Law::new(pieces).ok());
        Some(Plan { x: x?, y: y?, z: z?, filament: filament?, advances, path, ends })
    }
}

/// Maximum duration of a phase that is only a rounding error, s.
const MIN_PHASE_S: f64 = 1e-12;

/// Returns the durations and accelerations of a trapezoid's phases.
fn phases(speeds: &MoveSpeeds, length_mm: f64) -> [(f64, f64); 3] {
    let MoveSpeeds { entry_mm_per_s: entry, cruise_mm_per_s: cruise, exit_mm_per_s: exit, acceleration_mm_per_s2: a } =
        *speeds;
    let ramps_mm = (2.0 * cruise * cruise - entry * entry - exit * exit) / (2.0 * a);
    let cruise_s = if cruise > 0.0 { (length_mm - ramps_mm).max(0.0) / cruise } else { 0.0 };
    [((cruise - entry) / a, a), (cruise_s, 0.0), ((cruise - exit) / a, -a)]
}

/// Returns the duration of each of a job's moves with these speeds, s.
pub fn durations_s(job: &Job, speeds: &[MoveSpeeds]) -> Vec<f64> {
    let duration_s = |one: &Move, speeds: &MoveSpeeds| {
        let phases = phases(speeds, MoveShape::of(one).length_mm);
        phases.into_iter().map(|(duration_s, _)| duration_s).filter(|duration_s| *duration_s > MIN_PHASE_S).sum()
    };
    job.moves.iter().zip(speeds).map(|(one, speeds)| duration_s(one, speeds)).collect()
}

/// Filters applied between a plan and the motors.
#[derive(Clone, Debug)]
pub struct Filters {
    /// Shapers of X and Y.
    pub shapers: [Shaper; 2],
    /// Filter of the filament.
    pub extruder: ExtruderFilter,
}

impl Filters {
    /// Returns the time by which the filters begin earlier and end later than the plan, s.
    pub(crate) fn half_length_s(&self) -> f64 {
        let half_s = |shaper: &Shaper| {
            let centred = shaper.clone().centred();
            centred.impulses().iter().map(|one| one.delay_s.abs()).fold(0.0, f64::max)
        };
        let [x, y] = &self.shapers;
        let boxes_s: f64 = self.extruder.boxes_s.iter().sum();
        half_s(x).max(half_s(y)).max(half_s(&self.extruder.shaper) + 0.5 * boxes_s)
    }
}

impl Default for Filters {
    /// Returns filters that change nothing.
    fn default() -> Self {
        Self { shapers: [Shaper::identity(), Shaper::identity()], extruder: ExtruderFilter::default() }
    }
}

/// Frame and nozzle on which a plan or a trace is played.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Machine {
    /// The frame.
    pub frame: FrameSettings,
    /// The nozzle.
    pub nozzle: NozzleSettings,
}

/// Reason why a machine cannot have these settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MachineError {
    /// The frame's settings are out of range.
    Frame(FrameError),
    /// The nozzle's settings are out of range.
    Nozzle(NozzleError),
}

impl fmt::Display for MachineError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frame(error) => error.fmt(out),
            Self::Nozzle(error) => error.fmt(out),
        }
    }
}

impl std::error::Error for MachineError {}

impl Machine {
    /// Creates the frame and the nozzle at rest.
    ///
    /// # Errors
    /// A setting is out of range.
    pub fn at_rest(&self) -> Result<(Frame, Nozzle), MachineError> {
        let frame = Frame::new(&self.frame).map_err(MachineError::Frame)?;
        Ok((frame, Nozzle::new(self.nozzle).map_err(MachineError::Nozzle)?))
    }
}

/// Plays plans one after the other on a machine and measures. Returns their total duration, s.
///
/// # Errors
/// The machine's settings are out of range.
pub fn simulate(
    plans: &[Plan],
    filters: &Filters,
    machine: &Machine,
    filament_mm2: f64,
    measures: &mut Measures,
) -> Result<f64, MachineError> {
    let (frame, nozzle) = machine.at_rest()?;
    let shapers = filters.shapers.clone().map(Shaper::centred);
    // Each plan is played with its margins, so that none sees the ringing of another.
    let (mut base_s, mut time_s) = (0.0, 0.0);
    for plan in plans {
        let player = Player { plan, shapers: &shapers, filters, filament_mm2, base_s };
        player.play(frame, nozzle, measures);
        base_s += plan.duration_s() + 2.0 * MARGIN_S;
        time_s += plan.duration_s();
    }
    Ok(time_s)
}

struct Player<'a> {
    plan: &'a Plan,
    shapers: &'a [Shaper; 2],
    filters: &'a Filters,
    filament_mm2: f64,
    /// Time of the plan's start in the results, s.
    base_s: f64,
}

impl Player<'_> {
    fn play(&self, mut frame: Frame, mut nozzle: Nozzle, measures: &mut Measures) {
        let plan = self.plan;
        let mut path = plan.path.iter().peekable();
        let [mut x, mut y] = [(&plan.x, &self.shapers[0]), (&plan.y, &self.shapers[1])]
            .map(|(law, shaper)| ShapedCursor::new(ShapedLaw { law, impulses: shaper.impulses() }));
        let mut time_s = -MARGIN_S;
        let end_s = plan.duration_s() + MARGIN_S;
        let advanced = plan.advanced_filament(self.filters.extruder.advance_s);
        let extruder_shaper = self.filters.extruder.shaper.clone().centred();
        let shaped = ShapedLaw { law: &advanced, impulses: extruder_shaper.impulses() };
        let mut filament = ExtruderSamples::new(shaped, &self.filters.extruder.boxes_s, time_s);
        let mut filament_mm = filament.next_mm();
        let mut command = [x.at(time_s), y.at(time_s)];
        frame.shift(command.map(|one| one.position_mm));
        let mut rest = Rest::default();
        let mut index = 0u64;
        let mut restart = true;
        while time_s < end_s {
            index += 1;
            let sample_s = -MARGIN_S + index as f64 * SAMPLE_S;
            while time_s < sample_s {
                let until_s = x.next_breakpoint_s(time_s).min(y.next_breakpoint_s(time_s)).min(sample_s);
                // The middle lies within one piece for every impulse; the ends, because of
                // rounding, may not.
                let half_s = 0.5 * (until_s - time_s);
                command = [x.at(time_s + half_s), y.at(time_s + half_s)].map(|one| one.after(-half_s));
                if let Some(amplitude_mm) = rest.look(time_s, command, &frame) {
                    measures.stopped(self.base_s + rest.since_s, amplitude_mm);
                }
                frame.advance(until_s - time_s, command);
                command = command.map(|one| one.after(until_s - time_s));
                time_s = until_s;
            }
            let before_mm = std::mem::replace(&mut filament_mm, filament.next_mm());
            let feed_mm3_per_s = (filament_mm - before_mm) / SAMPLE_S * self.filament_mm2;
            let out_mm3 = nozzle.advance(SAMPLE_S, feed_mm3_per_s);
            while let Some(segment) = path.next_if(|segment| segment.start_s <= time_s + 1.0) {
                measures.push_segment(PathSegment {
                    start_s: segment.start_s + self.base_s,
                    end_s: segment.end_s + self.base_s,
                    ..*segment
                });
            }
            if path.peek().is_none() {
                measures.nothing_until(self.base_s + time_s + 1.0);
            }
            measures.push_sample(Sample {
                time_s: self.base_s + time_s,
                command_mm: command.map(|one| one.position_mm),
                nozzle_mm: frame.position_mm(),
                nozzle_mm_per_s: frame.speed_mm_per_s(),
                filament_mm,
                out_mm3,
                restart: std::mem::take(&mut restart),
            });
        }
        if let Some(amplitude_mm) =
            rest.look(end_s + STOP_S, command.map(|one| Motion::standing(one.position_mm)), &frame)
        {
            measures.stopped(self.base_s + rest.since_s, amplitude_mm);
        }
    }
}

/// Detects when X and Y have stopped.
#[derive(Debug, Default)]
struct Rest {
    since_s: f64,
    amplitude_mm: Option<f64>,
    has_moved: bool,
}

impl Rest {
    /// Must be called wherever the motion may change. Returns the amplitude at the start of a stop
    /// once the stop has lasted long enough.
    fn look(&mut self, time_s: f64, command: [Motion; 2], frame: &Frame) -> Option<f64> {
        if !command.iter().all(|one| one.is_standing()) {
            self.has_moved = true;
            self.amplitude_mm = None;
            return None;
        }
        if !self.has_moved {
            return None;
        }
        let amplitude_mm = *self.amplitude_mm.get_or_insert_with(|| {
            self.since_s = time_s;
            frame.ringing_mm(command)
        });
        (time_s >= self.since_s + STOP_S).then(|| {
            self.has_moved = false;
            self.amplitude_mm = None;
            amplitude_mm
        })
    }
}

#[cfg(test)]
mod tests;
