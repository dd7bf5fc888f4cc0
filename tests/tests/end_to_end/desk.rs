//! Runs jobs on the desk without the command around it.

use std::cell::RefCell;
use std::io::Read;

use ferrostep_hal_shim::FanOutput;
use ferrostep_planner::StepObserver;
use ferrostep_planner::{Kinematics, TICKS_PER_SECOND};
use ferrostep_printer::{Profile, Tally};
use ferrostep_session::desk::{Desk, Figures, LOOK_AHEAD_BLOCKS, MotionState};
use ferrostep_session::gpre;
use ferrostep_session::job::{self, JobError, JobProgress};
use ferrostep_session::record::Observer;
use ferrostep_session::{JobReplies, Session};

/// One of the shipped machines.
pub fn profile(name: &str) -> Profile {
    ferrostep_profiles::load(name).unwrap()
}

/// A job that has ended.
#[derive(Debug)]
pub struct Ended {
    /// Outcome of the job.
    pub outcome: Result<(), JobError>,
    /// Lines that were read.
    pub lines: u32,
    /// Counts of the motors.
    pub figures: Figures,
    /// X, Y, Z and E as the G-code counts them, units of 10 nm.
    pub logical_10nm: [i64; 4],
    /// Counts of the printer.
    pub tally: Tally,
    /// Powers that were asked of the fans, 0 to 255, by output.
    pub fan_powers: [u8; FanOutput::COUNT],
    /// Lines for a person.
    pub notices: Vec<String>,
    /// The trace, as a file would hold it.
    pub trace: Vec<u8>,
}

/// Runs a job; keeps no trace.
pub fn rehearse(profile: &Profile, look_ahead: usize, input: &mut impl Read) -> Ended {
    run(profile, look_ahead, input, Trace { bytes: Vec::new(), kept: false })
}

/// Runs a job with the usual look-ahead and keeps its trace.
pub fn rehearse_traced(profile: &Profile, input: &mut impl Read) -> Ended {
    run(profile, LOOK_AHEAD_BLOCKS, input, Trace::new(profile))
}

/// Runs a job with this look-ahead and keeps its trace.
pub fn rehearse_at(profile: &Profile, look_ahead: usize, input: &mut impl Read) -> Ended {
    run(profile, look_ahead, input, Trace::new(profile))
}

/// Runs a job with unlimited look-ahead and keeps its trace; takes a prepared job or G-code.
pub fn rehearse_far(profile: &Profile, input: &mut impl Read, prepared: bool) -> Ended {
    let job = if prepared { Job::Prepared { from: 0, behind: &[] } } else { Job::Text };
    run_either(profile, gpre::LOOK_AHEAD_BLOCKS, input, Trace::new(profile), job)
}

/// Enters a prepared job at a frame, with unlimited look-ahead, and keeps its trace.
pub fn rehearse_from(profile: &Profile, frame: u32, input: &mut impl Read) -> Ended {
    run_either(profile, gpre::LOOK_AHEAD_BLOCKS, input, Trace::new(profile), Job::Prepared { from: frame, behind: &[] })
}

/// Prints a prepared job on a machine that has executed these lines before, and keeps its trace.
pub fn rehearse_behind(profile: &Profile, behind: &[&str], input: &mut impl Read) -> Ended {
    run_either(profile, gpre::LOOK_AHEAD_BLOCKS, input, Trace::new(profile), Job::Prepared { from: 0, behind })
}

fn run(profile: &Profile, look_ahead: usize, input: &mut impl Read, trace: Trace) -> Ended {
    run_either(profile, look_ahead, input, trace, Job::Text)
}

/// The printed job.
enum Job<'a> {
    /// G-code.
    Text,
    /// A prepared job from a frame on, after some lines of G-code.
    Prepared { from: u32, behind: &'a [&'a str] },
}

fn run_either(profile: &Profile, look_ahead: usize, input: &mut impl Read, trace: Trace, job: Job<'_>) -> Ended {
    let notices = RefCell::new(Vec::new());
    let replies = JobReplies::new(|text: &str| notices.borrow_mut().push(text.to_owned()));
    let session = Session::print(*profile, look_ahead, trace, replies);
    let mut progress = JobProgress::default();
    let (outcome, tally, logical_10nm) = {
        let mut printer = session.printer();
        let outcome = if let Job::Prepared { from, behind } = job {
            for line in behind {
                session.run(printer.execute(0, line)).unwrap();
            }
            session.run(gpre::play_from(from, input, profile, &mut printer, &mut progress, |_| {}))
        } else {
            session.run(job::run(input, &mut printer, &mut progress, |_| {}))
        };
        (outcome, printer.tally(), printer.logical_10nm())
    };
    let figures = session.figures();
    let fan_powers = session.desk().state().fan_demand().powers;
    let trace = session.into_observer().bytes;
    let notices = notices.take();
    Ended { outcome, lines: progress.lines, figures, logical_10nm, tally, fan_powers, notices, trace }
}

/// The trace format in memory, written from its definition.
struct Trace {
    bytes: Vec<u8>,
    kept: bool,
}

impl Trace {
    fn new(profile: &Profile) -> Self {
        let (kinematics, axes) = match profile.kinematics {
            Kinematics::Cartesian => ("cartesian", "xyze"),
            Kinematics::CoreXy => ("corexy", "abze"),
            Kinematics::CoreXz => ("corexz", "ayce"),
        };
        let header = serde_json::json!({
            "format": "ferrostep-trace",
            "version": 1,
            "tick_hz": TICKS_PER_SECOND,
            "axes": axes.chars().collect::<Vec<_>>(),
            "steps_per_mm": profile.steps_per_mm.map(|steps| steps.to_f64()),
            "kinematics": kinematics,
        });
        Self { bytes: format!("{header}\n").into_bytes(), kept: true }
    }

    fn record(&mut self, tick: u64, rest: [u8; 4]) {
        if self.kept {
            self.bytes.extend(tick.to_le_bytes());
            self.bytes.extend(rest);
        }
    }
}

impl StepObserver for Trace {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.record(tick, [0, axes, directions, 0]);
    }
}

impl Observer for Trace {
    fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        self.record(tick, [1, 0, 0, 0]);
        if self.kept {
            for steps in motor_steps {
                self.bytes.extend(i32::try_from(steps).unwrap().to_le_bytes());
            }
        }
    }

    fn move_ended(&mut self, tick: u64, line: u32) {
        self.record(tick, [2, 0, 0, 0]);
        if self.kept {
            self.bytes.extend(line.to_le_bytes());
        }
    }
}
