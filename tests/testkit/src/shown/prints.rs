//! Prints for the page.
#![allow(clippy::unwrap_used, reason = "files and profiles of the repository")]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock};

use ferrostep_analysis::recording::{self, Shown};
use ferrostep_planner::{StepObserver, TICKS_PER_SECOND};
use ferrostep_profiles::PlannedBy;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::input::Input;
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::record::Observer;
use ferrostep_session::rules::RuledMachine;
use ferrostep_session::{JobReplies, Session};

use crate::program::repository;

/// A job on a machine.
#[derive(Clone, Copy, Debug)]
pub struct Print {
    /// Path from the root.
    pub file: &'static str,
    /// The machine.
    pub profile: &'static str,
}

/// The cube.
pub const CUBE: Print = Print { file: "examples/cube.gcode", profile: "cartesian" };
/// The gyroid.
pub const GYROID: Print = Print { file: "examples/gyroid.gcode.gz", profile: "cartesian" };
/// Arcs on a CoreXY.
pub const ARCS: Print = Print { file: "examples/arcs-corexy.gcode.gz", profile: "corexy" };

/// The places of a print, once they have been counted.
type Known = Arc<OnceLock<Arc<Vec<Place>>>>;

impl Print {
    /// The record for its page.
    ///
    /// # Panics
    /// The job cannot be printed.
    pub fn shown(self, max_nodes: usize) -> Shown {
        shown(&repository().join(self.file), self.profile, max_nodes)
    }

    /// Runs it for an observer of its steps.
    fn watched<O: Observer>(self, observer: O) -> O {
        let profile = ferrostep_profiles::load(self.profile).unwrap();
        let mut input = Input::open(&repository().join(self.file)).unwrap();
        let session = Session::print(profile, LOOK_AHEAD_BLOCKS, observer, JobReplies::new(|_: &str| {}));
        let mut printer = session.printer();
        session.run(job::run(&mut input, &mut printer, &mut JobProgress::default(), |_| {})).unwrap();
        session.into_observer()
    }

    /// Ten moves that take long enough to measure a speed within them, and the motors' places
    /// there: by counting steps, once for all tests.
    ///
    /// # Panics
    /// The job cannot be printed, or has too few long moves.
    pub fn ten_places(self) -> Arc<Vec<Place>> {
        static KNOWN: Mutex<BTreeMap<&str, Known>> = Mutex::new(BTreeMap::new());
        let known = Arc::clone(KNOWN.lock().unwrap().entry(self.file).or_default());
        Arc::clone(known.get_or_init(|| Arc::new(self.count_places())))
    }

    fn count_places(self) -> Vec<Place> {
        let ends = self.watched(Ends::default()).long;
        assert!(ends.len() >= 10, "{} has {} long moves", self.file, ends.len());
        let chosen = (0..10).map(|number| ends[(2 * number + 1) * ends.len() / 20]);
        let mut places: Vec<Place> = chosen.map(Place::of).collect();
        let ticks = places.iter().flat_map(|place| place.ticks).collect();
        let motors = self.watched(At { ticks, ..At::default() }).places;
        let profile = ferrostep_profiles::load(self.profile).unwrap();
        for (place, motors) in places.iter_mut().zip(motors.chunks(5)) {
            let position = |steps: [i64; 4]| {
                let motors = [0, 1, 2].map(|motor| steps[motor] as f64 / profile.steps_per_mm[motor].to_f64());
                profile.kinematics.position(motors)
            };
            let extruder_mm = |steps: [i64; 4]| steps[3] as f64 / profile.steps_per_mm[3].to_f64();
            let [from, before, middle, after, to] = [0, 1, 2, 3, 4].map(|number| motors[number]);
            place.position_mm = position(middle);
            let sides = position(before).into_iter().zip(position(after));
            let way_mm = sides.map(|(a, b)| (b - a) * (b - a)).sum::<f64>().sqrt();
            place.speed_mm_per_s = way_mm / (2.0 * WINDOW_S);
            place.filament_mm = extruder_mm(to) - extruder_mm(from);
        }
        places
    }
}

/// The record for the page of a file.
///
/// # Panics
/// The file cannot be printed.
pub fn shown(file: &Path, profile: &str, max_nodes: usize) -> Shown {
    shown_by(PlannedBy::Own, file, profile, max_nodes)
}

/// The record for the page of a file, by the rules of a firmware.
///
/// # Panics
/// The file cannot be printed.
pub fn shown_by(rules: PlannedBy, file: &Path, profile: &str, max_nodes: usize) -> Shown {
    let RuledMachine { profile, by, .. } = RuledMachine::load(profile, Some(rules)).unwrap();
    let mut input = Input::open(file).unwrap();
    recording::record(profile, by, &mut input, max_nodes, JobReplies::new(|_: &str| {}), |_, _| {}).unwrap()
}

/// Time to both sides over which a speed is measured.
pub const WINDOW_S: f64 = 0.008;
const WINDOW_TICKS: u64 = (WINDOW_S * TICKS_PER_SECOND as f64) as u64;

/// The middle of a move, by its steps.
#[derive(Clone, Debug)]
pub struct Place {
    /// Line of the file.
    pub line: u32,
    /// Time from the middle to the move's end.
    pub to_end_s: f64,
    /// Position of the nozzle.
    pub position_mm: [f64; 3],
    /// Mean speed over the window.
    pub speed_mm_per_s: f64,
    /// Filament of the whole move.
    pub filament_mm: f64,
    /// The move's start, the window's, its middle, the window's end and the move's.
    ticks: [u64; 5],
}

impl Place {
    fn of((line, from, to): (u32, u64, u64)) -> Self {
        let middle = from + (to - from) / 2;
        Self {
            line,
            to_end_s: (to - middle) as f64 / f64::from(TICKS_PER_SECOND),
            position_mm: [0.0; 3],
            speed_mm_per_s: 0.0,
            filament_mm: 0.0,
            ticks: [from, middle - WINDOW_TICKS, middle, middle + WINDOW_TICKS, to],
        }
    }
}

/// The moves that take long: line, and ticks of their start and their end.
#[derive(Default)]
struct Ends {
    last_tick: u64,
    /// True if X, Y or Z have stepped since the last end.
    has_moved: bool,
    long: Vec<(u32, u64, u64)>,
}

impl StepObserver for Ends {
    fn stepped(&mut self, _tick: u64, axes: u8, _directions: u8) {
        self.has_moved |= axes & 0b111 != 0;
    }
}

impl Observer for Ends {
    fn redefined(&mut self, tick: u64, _motor_steps: [i64; 4]) {
        self.last_tick = tick;
    }

    fn move_ended(&mut self, tick: u64, line: u32) {
        let from = std::mem::replace(&mut self.last_tick, tick);
        if std::mem::take(&mut self.has_moved) && from > 0 && tick - from > 5 * WINDOW_TICKS {
            self.long.push((line, from, tick));
        }
    }
}

/// The motors' places at ticks.
#[derive(Default)]
struct At {
    ticks: Vec<u64>,
    motors: [i64; 4],
    places: Vec<[i64; 4]>,
}

impl StepObserver for At {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        while self.ticks.get(self.places.len()).is_some_and(|wanted| *wanted < tick) {
            self.places.push(self.motors);
        }
        for motor in 0..4 {
            if axes >> motor & 1 == 1 {
                self.motors[motor] += if directions >> motor & 1 == 1 { -1 } else { 1 };
            }
        }
    }
}

impl Observer for At {
    fn redefined(&mut self, _tick: u64, motor_steps: [i64; 4]) {
        self.motors = motor_steps;
    }

    fn move_ended(&mut self, _tick: u64, _line: u32) {}
}
