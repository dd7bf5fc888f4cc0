//! All methods of interpolation with all methods of acceleration, side by side on a real file.

mod extruder;

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use ferrostep_papers::tables::{Cell, Table};
use ferrostep_planner::kinematics::Kinematics;
use ferrostep_planner::{AccelerationProfile, EXTRUDER, Interpolation, Move, StepObserver, TICKS_PER_SECOND};
use ferrostep_printer::Profile;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::input::{self, Input, InputError};
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::record::Observer;
use ferrostep_session::{JobReplies, Session};

use extruder::{Extruder, Way};

/// Speeds, accelerations and jerks are measured over this many ticks, 10 ms: over less a single
/// step would show.
const WINDOW_TICKS: u64 = TICKS_PER_SECOND as u64 / 100;

/// The same in seconds.
const WINDOW_S: f64 = 0.01;

/// Number of times in a window at which the path is sampled.
const SAMPLES: usize = 8;

/// The motors that move the nozzle, as bits.
const MOTORS: u8 = 0b111;

/// Reason for which a comparison failed.
#[derive(Debug)]
pub enum CompareError {
    /// The file cannot be opened.
    Open(InputError),
    /// The file is a prepared job, which determines its own interpolation.
    Prepared,
    /// The job stopped.
    Stopped(String),
}

impl fmt::Display for CompareError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Open(error) => error.fmt(formatter),
            Self::Prepared => formatter.write_str(
                "this is a prepared job, with its methods fixed: give --compare the G-code that it was made from",
            ),
            Self::Stopped(message) => formatter.write_str(message),
        }
    }
}

impl std::error::Error for CompareError {}

/// All ways.
pub fn ways() -> impl Iterator<Item = (Interpolation, AccelerationProfile)> {
    AccelerationProfile::ALL
        .into_iter()
        .flat_map(|acceleration| Interpolation::ALL.into_iter().map(move |interpolation| (interpolation, acceleration)))
}

/// Prints a file by each combination of methods; `tell` is called before each print.
///
/// # Errors
/// The file cannot be opened, is a prepared job, or a print stopped.
pub fn compare(
    path: &Path,
    profile: &Profile,
    mut tell: impl FnMut(Interpolation, AccelerationProfile),
) -> Result<Table, CompareError> {
    // Read once: a pipe has its bytes only once.
    let job = input::bytes(path).map_err(CompareError::Open)?;
    let mut rows = Vec::new();
    for (interpolation, acceleration) in ways() {
        tell(interpolation, acceleration);
        let mut profile = *profile;
        profile.motion.interpolation = interpolation;
        profile.motion.acceleration = acceleration;
        rows.push(print(&job, &profile)?);
    }
    Ok(Table {
        key: "choices",
        title: format!("{}, profile {}: all choices", input::name(path), profile.name),
        columns: vec![
            "interpolation",
            "acceleration",
            "motion, s",
            "most events/s",
            "peak acceleration, mm/s^2",
            "peak jerk, mm/s^3",
            "largest path error, mm",
            "mean, mm",
            "extruder farthest off, steps",
            "order digest",
            "step digest",
        ],
        rows,
        note: note(profile),
    })
}

/// The meaning of the figures, and the precision of the coarser ones.
fn note(profile: &Profile) -> String {
    // Positions are whole steps: each is off by half of one at the most, and in a difference all
    // may be off the worse way.
    let [x, y, ..] = profile.steps_per_mm.map(|steps| steps.to_f64());
    let off_mm = 0.5 / x.min(y);
    let (acceleration, jerk) = (4.0 * off_mm / WINDOW_S.powi(2), 8.0 * off_mm / WINDOW_S.powi(3));
    format!(
        "Accelerations and jerks are those along the path, from the steps as they were made: differences over \
         {:.0} ms, which whole steps make uncertain by up to {acceleration:.0} mm/s^2 and {jerk:.0} mm/s^3. The table's \
         first frequency is reached in no time, as the paper has it. The path error is from where the motors stand to \
         the straight line between where they stood at the ends of the move, the extruder's distance from lambda s(t), \
         with s(t) by the steps of the motor that makes most, evenly between them.",
        WINDOW_S * 1000.0
    )
}

fn print(job: &Arc<[u8]>, profile: &Profile) -> Result<Vec<Cell>, CompareError> {
    let mut input = Input::of_bytes(Arc::clone(job)).map_err(CompareError::Open)?;
    if input.is_prepared() {
        return Err(CompareError::Prepared);
    }
    let session = Session::print(*profile, LOOK_AHEAD_BLOCKS, Watch::new(profile), JobReplies::new(|_: &str| {}));
    let mut printer = session.printer();
    let outcome = session.run(job::run(&mut input, &mut printer, &mut JobProgress::default(), |_| {}));
    outcome.map_err(|error| CompareError::Stopped(error.to_string()))?;
    let figures = session.figures();
    let watch = session.into_observer();
    let digest = |digest: u64| Cell::Text(format!("{digest:016x}"));
    Ok(vec![
        profile.motion.interpolation.name().into(),
        profile.motion.acceleration.name().into(),
        Cell::Number(figures.motion_time_s, 2),
        Cell::Count(i64::try_from(figures.max_event_rate_hz).unwrap_or(i64::MAX)),
        Cell::Number(watch.changes.acceleration, 0),
        Cell::Number(watch.changes.jerk, 0),
        Cell::Number(watch.largest_error_mm, 4),
        Cell::Number(watch.error_sum_mm / watch.events.max(1) as f64, 4),
        Cell::Number(watch.extruder.farthest_off_steps(), 3),
        digest(figures.digests.order),
        digest(figures.digests.step),
    ])
}

/// An event of the present move.
struct Event {
    tick: u64,
    axes: u8,
    motors: [i64; 3],
}

/// Measures the distance of the motors from the straight line, and the change of their speed.
struct Watch {
    kinematics: Kinematics,
    steps_per_mm: [f64; 3],
    motors: [i64; 3],
    start: [i64; 3],
    start_tick: u64,
    move_events: Vec<Event>,
    events: u64,
    error_sum_mm: f64,
    largest_error_mm: f64,
    changes: Changes,
    extruder: Extruder,
}

impl Watch {
    fn new(profile: &Profile) -> Self {
        let [x, y, z, e] = profile.steps_per_mm.map(|steps| steps.to_f64());
        Self {
            kinematics: profile.kinematics,
            steps_per_mm: [x, y, z],
            motors: [0; 3],
            start: [0; 3],
            start_tick: 0,
            move_events: Vec::new(),
            events: 0,
            error_sum_mm: 0.0,
            largest_error_mm: 0.0,
            changes: Changes::default(),
            extruder: Extruder::new(e),
        }
    }

    fn place_mm(&self, motors: [i64; 3]) -> [f64; 3] {
        let mut place = [0.0; 3];
        for (place, (motor, steps_per_mm)) in place.iter_mut().zip(motors.iter().zip(self.steps_per_mm)) {
            *place = *motor as f64 / steps_per_mm;
        }
        self.kinematics.position(place)
    }

    /// A move along a straight line has ended.
    fn measure(&mut self, end_tick: u64) {
        let (start, end) = (self.place_mm(self.start), self.place_mm(self.motors));
        let line = difference(end, start);
        let length = dot(line, line).sqrt();
        let events = std::mem::take(&mut self.move_events);
        if length > 0.0 {
            for event in &events {
                let place = difference(self.place_mm(event.motors), start);
                let along = (dot(place, line) / (length * length)).clamp(0.0, 1.0);
                let off = difference(place, line.map(|component| component * along));
                let error = dot(off, off).sqrt();
                self.error_sum_mm += error;
                self.largest_error_mm = self.largest_error_mm.max(error);
                self.events += 1;
            }
            let passed = passed(&events);
            passed.iter().for_each(|(tick, part)| self.changes.pass(*tick, length * part));
            self.changes.end(end_tick, length);
            self.extruder.move_ended(Some(Way { from_tick: self.start_tick, passed, to_tick: end_tick }));
        } else {
            self.changes.stand(end_tick);
            self.extruder.move_ended(None);
        }
        (self.start, self.start_tick) = (self.motors, end_tick);
        self.move_events = events;
        self.move_events.clear();
    }
}

/// The times at which parts of a move's path were passed, by the steps of the motor
/// that makes most.
fn passed(events: &[Event]) -> Vec<(u64, f64)> {
    let counts = [0, 1, 2].map(|motor| events.iter().filter(|event| event.axes >> motor & 1 == 1).count());
    let most = counts.into_iter().max().unwrap_or(0);
    let bit = counts.iter().position(|count| *count == most).unwrap_or(0);
    let steps = events.iter().filter(|event| event.axes >> bit & 1 == 1);
    steps.zip(0u32..).map(|(event, number)| (event.tick, (f64::from(number) + 0.5) / most as f64)).collect()
}

impl StepObserver for Watch {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        for (motor, steps) in self.motors.iter_mut().enumerate() {
            if axes >> motor & 1 == 1 {
                *steps += if directions >> motor & 1 == 1 { -1 } else { 1 };
            }
        }
        if axes & MOTORS != 0 {
            self.move_events.push(Event { tick, axes, motors: self.motors });
        }
        if axes & EXTRUDER != 0 {
            self.extruder.stepped(tick, if directions & EXTRUDER == 0 { 1 } else { -1 });
        }
    }
}

impl Observer for Watch {
    fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        let [x, y, z, _] = motor_steps;
        self.motors = [x, y, z];
        (self.start, self.start_tick) = (self.motors, tick);
        self.move_events.clear();
        self.extruder.broken_off();
        // Homing ends where the end stop triggers.
        self.changes.begin_anew(tick);
    }

    fn planned(&mut self, taken: &Move, _slowed_moves: u64) {
        self.extruder.planned(taken.filament_100pm, taken.ends_move);
    }

    fn move_ended(&mut self, tick: u64, _line: u32) {
        self.measure(tick);
    }
}

/// Second and third differences of the position along the path.
#[derive(Default)]
struct Changes {
    /// Path up to the present move, mm.
    before: f64,
    last: (u64, f64),
    /// Positions at equally spaced times, of three windows.
    samples: std::collections::VecDeque<f64>,
    next_sample: u64,
    acceleration: f64,
    jerk: f64,
}

impl Changes {
    fn begin_anew(&mut self, tick: u64) {
        self.samples.clear();
        self.last = (tick, self.before);
        self.next_sample = tick;
    }

    /// The position along the present move at this tick.
    fn pass(&mut self, tick: u64, along: f64) {
        let here = (tick, self.before + along);
        let (from, way) = self.last;
        let step = WINDOW_TICKS / SAMPLES as u64;
        while self.next_sample <= tick {
            let share = if tick > from { (self.next_sample - from) as f64 / (tick - from) as f64 } else { 1.0 };
            self.sample(way + (here.1 - way) * share);
            self.next_sample += step;
        }
        if tick >= from {
            self.last = here;
        }
    }

    fn end(&mut self, tick: u64, length: f64) {
        self.pass(tick, length);
        self.before += length;
    }

    fn stand(&mut self, tick: u64) {
        self.pass(tick, 0.0);
    }

    fn sample(&mut self, way: f64) {
        self.samples.push_back(way);
        if self.samples.len() <= 3 * SAMPLES {
            return;
        }
        let at = |window: usize| self.samples[window * SAMPLES];
        let second = |window: usize| (at(window + 2) - 2.0 * at(window + 1) + at(window)) / (WINDOW_S * WINDOW_S);
        let (now, then) = (second(1), second(0));
        self.acceleration = self.acceleration.max(now.abs());
        self.jerk = self.jerk.max((now - then).abs() / WINDOW_S);
        self.samples.pop_front();
    }
}

fn difference(one: [f64; 3], other: [f64; 3]) -> [f64; 3] {
    let ([x, y, z], [a, b, c]) = (one, other);
    [x - a, y - b, z - c]
}

fn dot(one: [f64; 3], other: [f64; 3]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_acceleration_is_found() {
        let mut changes = Changes::default();
        // 500 mm/s^2 for half a second.
        for index in 0..=5000u64 {
            let seconds = index as f64 * 1e-4;
            changes.pass(index * 8_400, 250.0 * seconds * seconds);
        }
        assert!((changes.acceleration - 500.0).abs() < 0.5, "{}", changes.acceleration);
        assert!(changes.jerk < 100.0, "{}", changes.jerk);
    }

    #[test]
    fn a_constant_jerk_is_found() {
        let mut changes = Changes::default();
        for index in 0..=5000u64 {
            let seconds = index as f64 * 1e-4;
            changes.pass(index * 8_400, 10_000.0 * seconds * seconds * seconds / 6.0);
        }
        assert!((changes.jerk - 10_000.0).abs() < 200.0, "{}", changes.jerk);
    }

    #[test]
    fn there_are_twenty_ways() {
        assert_eq!(ways().count(), 20);
    }
}
