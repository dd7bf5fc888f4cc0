//! Plays the step events of a trace on a frame and a nozzle.
//!
//! The frame feels whole steps: the motors rest between two events. Measures of the motors
//! themselves (acceleration, the extruder's flow) take each step as the crossing of the middle
//! between two positions and interpolate linearly between crossings, as a rotor moves: differences
//! of whole steps would be pure noise.

mod crossings;
mod path_source;
mod planned;

pub use path_source::{PathError, PathSource};

use crate::frame::Frame;
use crate::measures::{Measures, SAMPLE_S, STOP_S, Sample};
use crate::motion::Motion;
use crate::nozzle::Nozzle;
use crate::plan::{Machine, MachineError};
use crossings::Crossings;
use ferrostep_oracle::trace::{Record, TraceError, TraceHeader};
use std::collections::VecDeque;
use std::fmt;
use std::ops::RangeInclusive;

/// Maximum length of a pause that is simulated, s; of a longer one only the beginning is.
const LONGEST_PAUSE_S: u64 = 2;

/// Range of a motor's steps/mm: it includes every real motor, and prevents a few steps from making
/// a path of kilometres.
const STEPS_PER_MM: RangeInclusive<f64> = 0.1..=1e6;

/// Number of motors of a trace that can be simulated.
const MOTORS: usize = 4;

/// Reason why a trace cannot be simulated.
#[derive(Debug)]
pub enum StepsError {
    /// The trace cannot be read.
    Trace(TraceError),
    /// The header does not name four motors of which the last is e; the names.
    Motors(Vec<String>),
    /// A motor's steps/mm are out of range; the motor's name.
    Scale(String),
    /// A record's time is before that of the previous record.
    Backwards {
        /// Time of the record, ticks.
        tick: u64,
        /// Time of the previous record, ticks.
        before: u64,
    },
    /// The path does not match the trace.
    Path(PathError),
    /// The machine's settings are out of range.
    Machine(MachineError),
}

impl fmt::Display for StepsError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Trace(error) => error.fmt(out),
            Self::Motors(names) => write!(
                out,
                "trace header: the motors are {names:?}, expected three of the axes and e: the simulator knows cartesian, corexy and corexz"
            ),
            Self::Scale(name) => write!(
                out,
                "trace header: steps_per_mm of {name:?} is out of range, expected {} to {}",
                STEPS_PER_MM.start(),
                STEPS_PER_MM.end()
            ),
            Self::Backwards { tick, before } => write!(
                out,
                "trace: a record at tick {tick} comes after one at tick {before}, expected ticks that never go back"
            ),
            Self::Path(error) => error.fmt(out),
            Self::Machine(error) => error.fmt(out),
        }
    }
}

impl std::error::Error for StepsError {}

impl From<MachineError> for StepsError {
    fn from(error: MachineError) -> Self {
        Self::Machine(error)
    }
}

impl From<PathError> for StepsError {
    fn from(error: PathError) -> Self {
        Self::Path(error)
    }
}

/// Plays step events on a machine as they arrive; memory does not grow with their number.
#[derive(Debug)]
pub struct StepSimulation {
    header: TraceHeader,
    mm_per_step: [f64; MOTORS],
    filament_mm2: f64,
    frame: Frame,
    nozzle: Nozzle,
    path: PathSource,
    measures: Measures,
    motors: [i64; MOTORS],
    first_tick: Option<u64>,
    last_tick: u64,
    /// Parts of pauses that were skipped, in whole ticks: an f64 cannot hold every tick count, and
    /// a sum of seconds is not exact.
    left_out_ticks: u64,
    /// Time up to which the frame is simulated, s.
    time_s: f64,
    samples: u64,
    /// Positions at samples, in steps, by motor.
    crossings: [Crossings; MOTORS],
    /// Samples whose motor positions are not known yet.
    waiting: VecDeque<Sample>,
    before_mm: Option<f64>,
    restart: bool,
    last_plane_step_s: Option<f64>,
    ringing_mm: f64,
    /// Time of the last move end, and the stops since then, which count unless the motion was
    /// homing.
    since: SinceMoveEnd,
    /// Time spent homing, s.
    homing_s: f64,
}

/// Motion that may turn out to be homing.
#[derive(Debug, Default)]
struct SinceMoveEnd {
    time_s: f64,
    /// Times, s, and amplitudes, mm.
    stops: Vec<(f64, f64)>,
    has_extruded: bool,
}

impl StepSimulation {
    /// Creates a machine at rest, for the motors of a trace.
    ///
    /// # Errors
    /// The header or the machine is unusable.
    pub fn new(
        header: TraceHeader,
        machine: &Machine,
        filament_mm2: f64,
        path: PathSource,
        measures: Measures,
    ) -> Result<Self, StepsError> {
        let is_e_last = header.axes.last().is_some_and(|name| name.eq_ignore_ascii_case("e"));
        let &[x, y, z, e] = header.steps_per_mm.as_slice() else { return Err(StepsError::Motors(header.axes)) };
        if !is_e_last {
            return Err(StepsError::Motors(header.axes));
        }
        for (name, scale) in header.axes.iter().zip([x, y, z, e]) {
            if !STEPS_PER_MM.contains(&scale) {
                return Err(StepsError::Scale(name.clone()));
            }
        }
        let (frame, nozzle) = machine.at_rest()?;
        Ok(Self {
            mm_per_step: [x, y, z, e].map(|scale| 1.0 / scale),
            header,
            filament_mm2,
            frame,
            nozzle,
            path,
            measures,
            motors: [0; MOTORS],
            first_tick: None,
            last_tick: 0,
            left_out_ticks: 0,
            time_s: 0.0,
            samples: 0,
            crossings: std::array::from_fn(|_| Crossings::default()),
            waiting: VecDeque::new(),
            before_mm: None,
            restart: true,
            last_plane_step_s: None,
            ringing_mm: 0.0,
            since: SinceMoveEnd::default(),
            homing_s: 0.0,
        })
    }

    /// Returns the position of the tool in X and Y, mm, for motors at these steps.
    fn plane_mm(&self, motors: [f64; MOTORS]) -> [f64; 2] {
        let [a, b, c, _] = motors;
        let [a_mm, b_mm, c_mm, _] = self.mm_per_step;
        let [x, y, _] = self.header.kinematics.twice_the_tool([a * a_mm, b * b_mm, c * c_mm]);
        [0.5 * x, 0.5 * y]
    }

    fn command(&self) -> [Motion; 2] {
        self.plane_mm(self.motors.map(|steps| steps as f64)).map(Motion::standing)
    }

    /// Returns the time of a tick since the first one, s, with long pauses shortened.
    fn time_of(&mut self, tick: u64) -> Result<f64, StepsError> {
        let first = *self.first_tick.get_or_insert_with(|| {
            self.last_tick = tick;
            tick
        });
        if tick < self.last_tick {
            return Err(StepsError::Backwards { tick, before: self.last_tick });
        }
        let longest = LONGEST_PAUSE_S.saturating_mul(self.header.tick_hz);
        self.left_out_ticks += (tick - self.last_tick).saturating_sub(longest);
        self.last_tick = tick;
        Ok(self.seconds(tick - first - self.left_out_ticks))
    }

    fn seconds(&self, ticks: u64) -> f64 {
        ticks as f64 / self.header.tick_hz as f64
    }

    /// Plays a record.
    ///
    /// # Errors
    /// The record's time is before that of the previous one, or the record does not match the path.
    pub fn play(&mut self, record: &Record) -> Result<(), StepsError> {
        match record {
            Record::Step(event) => {
                let time_s = self.time_of(event.tick)?;
                self.pass_to(time_s);
                self.step(time_s, event.axes, event.directions);
            }
            Record::PositionsRedefined { tick, positions } => {
                let time_s = self.time_of(*tick)?;
                self.pass_to(time_s);
                self.redefine(time_s, positions);
            }
            Record::MoveEnd { tick, line } => {
                let time_s = self.time_of(*tick)?;
                self.pass_to(time_s);
                let place_mm = self.plane_mm(self.motors.map(|steps| steps as f64));
                let filament_mm = self.motors[3] as f64 * self.mm_per_step[3];
                self.path.move_ended(time_s, *line, place_mm, filament_mm, &mut self.measures)?;
                self.count_stops(time_s);
            }
        }
        Ok(())
    }

    /// Notes that the printer adds moves before the move of this line, which are not part of the
    /// path.
    pub fn own_moves_before(&mut self, line: u32) {
        self.path.own_moves_before(line);
    }

    /// Counts the stops since the last move end, which were not homing.
    fn count_stops(&mut self, time_s: f64) {
        let since = std::mem::replace(&mut self.since, SinceMoveEnd { time_s, ..SinceMoveEnd::default() });
        for (time_s, amplitude_mm) in since.stops {
            self.measures.stopped(time_s, amplitude_mm);
        }
    }

    fn step(&mut self, time_s: f64, axes: u8, directions: u8) {
        self.since.has_extruded |= axes >> (MOTORS - 1) & 1 == 1;
        let before = self.motors;
        for motor in 0..MOTORS {
            if axes >> motor & 1 == 1 {
                let step = if directions >> motor & 1 == 1 { -1 } else { 1 };
                self.motors[motor] += step;
                self.crossings[motor].step(time_s, step);
            }
        }
        let plane_mm = self.plane_mm(self.motors.map(|steps| steps as f64));
        if plane_mm != self.plane_mm(before.map(|steps| steps as f64)) {
            self.last_plane_step_s = Some(time_s);
            self.ringing_mm = self.frame.ringing_mm(self.command());
        }
        self.path.stepped(time_s, plane_mm, self.motors[3] as f64 * self.mm_per_step[3], &mut self.measures);
    }

    fn redefine(&mut self, time_s: f64, positions: &[i32]) {
        if self.since.has_extruded {
            self.count_stops(time_s);
        } else {
            // Motion without the extruder up to a redefined position is homing, which is not part
            // of the job.
            self.homing_s += time_s - self.since.time_s;
            self.since = SinceMoveEnd { time_s, ..SinceMoveEnd::default() };
            self.last_plane_step_s = None;
        }
        let before_mm = self.plane_mm(self.motors.map(|steps| steps as f64));
        for ((motor, crossings), position) in self.motors.iter_mut().zip(&mut self.crossings).zip(positions) {
            let position = i64::from(*position);
            crossings.redefine(time_s, position - *motor);
            *motor = position;
        }
        let after_mm = self.plane_mm(self.motors.map(|steps| steps as f64));
        self.frame.shift([after_mm[0] - before_mm[0], after_mm[1] - before_mm[1]]);
        self.restart = true;
        self.path.restart(time_s, after_mm, self.motors[3] as f64 * self.mm_per_step[3], &mut self.measures);
    }

    /// Simulates the frame up to a time, taking a sample at each multiple of the sampling interval.
    fn pass_to(&mut self, until_s: f64) {
        let command = self.command();
        loop {
            let sample_s = (self.samples + 1) as f64 * SAMPLE_S;
            if sample_s > until_s {
                break;
            }
            self.frame.advance(sample_s - self.time_s, command);
            self.time_s = sample_s;
            self.samples += 1;
            self.stop_if_due();
            self.waiting.push_back(Sample {
                time_s: sample_s,
                nozzle_mm: self.frame.position_mm(),
                nozzle_mm_per_s: self.frame.speed_mm_per_s(),
                restart: std::mem::take(&mut self.restart),
                ..Sample::default()
            });
            self.crossings.iter_mut().for_each(|one| one.idle(sample_s));
            self.complete_samples();
        }
        if until_s > self.time_s {
            self.frame.advance(until_s - self.time_s, command);
            self.time_s = until_s;
        }
    }

    fn stop_if_due(&mut self) {
        let Some(stopped_s) = self.last_plane_step_s.filter(|stopped_s| self.time_s >= stopped_s + STOP_S) else {
            return;
        };
        self.last_plane_step_s = None;
        self.since.stops.push((stopped_s, self.ringing_mm));
    }

    /// Passes on the samples whose motor positions are known.
    fn complete_samples(&mut self) {
        while self.crossings.iter().all(Crossings::has_sample) {
            let Some(mut sample) = self.waiting.pop_front() else { return };
            let [a, b, c, e] = self.crossings.each_mut().map(Crossings::take_sample);
            sample.command_mm = self.plane_mm([a, b, c, e]);
            sample.filament_mm = e * self.mm_per_step[3];
            let before_mm = self.before_mm.replace(sample.filament_mm).filter(|_| !sample.restart);
            let fed_mm = sample.filament_mm - before_mm.unwrap_or(sample.filament_mm);
            sample.out_mm3 = self.nozzle.advance(SAMPLE_S, fed_mm / SAMPLE_S * self.filament_mm2);
            self.measures.push_sample(sample);
        }
    }

    /// Ends the simulation: lets everything come to rest, and returns the measures and the time
    /// from the first record to the last without homing, s.
    ///
    /// # Errors
    /// The path continues after the last step.
    pub fn finish(mut self) -> Result<(Measures, f64), StepsError> {
        let end_s = self.time_s;
        let time_s = end_s + self.seconds(self.left_out_ticks) - self.homing_s;
        self.path.finish(end_s, &mut self.measures)?;
        self.pass_to(end_s + 0.3);
        self.count_stops(end_s);
        self.measures.nothing_until(f64::INFINITY);
        Ok((self.measures, time_s))
    }
}

#[cfg(test)]
mod tests;
