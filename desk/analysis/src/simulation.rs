//! A job or a trace on a simulated frame and nozzle: what `ferrostep simulate` measures.

mod by_rules;
mod filters;
mod machine;
mod observer;
mod table;

pub use filters::{ComparedFilter, FilterError, FilterWords, SimulatedFilters};
pub use machine::{filament_mm2, reference_profile};
pub use table::{Compared, Simulated, SimulatedFilter, SimulatedMachine};

use std::borrow::Cow;
use std::fmt;
use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::Path;
use std::sync::Arc;

use ferrostep_oracle::reference::{InterpretError, InterpretOptions, Job, interpret, plan};
use ferrostep_oracle::trace::{TraceError, TraceReader};
use ferrostep_planner::AxisShaper;
use ferrostep_printer::{Profile, Skew};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::gpre;
use ferrostep_session::input::{self, Input, InputError};
use ferrostep_session::job::{self, JobError, JobProgress};
use ferrostep_session::macros;
use ferrostep_session::rules::ByRules;
use ferrostep_session::{JobReplies, Session};
use ferrostep_simulator::measures::{Measures, Report, Snapshots};
use ferrostep_simulator::plan::{Filters, Machine, MachineError, MoveSpeeds, Plan, durations_s, simulate};
use ferrostep_simulator::steps::{PathSource, StepSimulation, StepsError};

use by_rules::ByRulesPlan;
use observer::StepsObserver;

/// First byte of a trace; no job begins with it.
const TRACE_START: u8 = b'{';

/// A simulation could not be made.
#[derive(Debug)]
pub enum SimulationError {
    /// A file cannot be read, or is not a job.
    Input(InputError),
    /// The job stopped.
    Job(JobError),
    /// The path cannot be read from the G-code.
    Interpret(InterpretError),
    /// `--path` names a prepared job or a trace, not G-code.
    PathIsNoText,
    /// The steps cannot be simulated.
    Steps(StepsError),
    /// The frame's or the nozzle's numbers are out of range.
    Machine(MachineError),
    /// The options for filters and frame contradict each other.
    Filters(FilterError),
    /// Other rules plan G-code, which a trace or a prepared job lacks.
    NothingToCompare,
    /// The profile's axes are not at right angles, and a frame's are.
    Skew,
    /// The profile's drives have play, and those of the simulated machine have none.
    Backlash,
}

impl fmt::Display for SimulationError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(error) => error.fmt(out),
            Self::Job(error) => error.fmt(out),
            Self::Interpret(error) => write!(out, "the path cannot be read: {error}"),
            Self::PathIsNoText => {
                write!(out, "--path takes G-code: the file that the trace or the prepared job was made from")
            }
            Self::Steps(error @ StepsError::Path(_)) => {
                write!(out, "{error} (--path-of-steps measures against the path that the steps draw)")
            }
            Self::Steps(error) => error.fmt(out),
            Self::Machine(error) => error.fmt(out),
            Self::Filters(error) => error.fmt(out),
            Self::Skew => {
                write!(
                    out,
                    "the profile has a table skew, and the simulated frame is at right angles: take a profile without it"
                )
            }
            Self::Backlash => {
                write!(
                    out,
                    "the profile has a table backlash, and the simulated drives have no play: take a profile without it"
                )
            }
            Self::NothingToCompare => {
                write!(
                    out,
                    "--compare plans G-code: give it with --path FILE, a trace and a prepared job are already planned"
                )
            }
        }
    }
}

impl std::error::Error for SimulationError {}

impl From<InputError> for SimulationError {
    fn from(error: InputError) -> Self {
        Self::Input(error)
    }
}

impl From<StepsError> for SimulationError {
    fn from(error: StepsError) -> Self {
        Self::Steps(error)
    }
}

impl From<MachineError> for SimulationError {
    fn from(error: MachineError) -> Self {
        Self::Machine(error)
    }
}

impl From<FilterError> for SimulationError {
    fn from(error: FilterError) -> Self {
        Self::Filters(error)
    }
}

/// The kind of the simulated file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// G-code, printed on the virtual board.
    GCode,
    /// A prepared job, printed on the virtual board.
    Prepared,
    /// A trace.
    Trace,
}

/// The source of the steps.
enum Steps {
    Job(Arc<[u8]>),
    Trace(Box<TraceReader<Box<dyn Read>>>),
}

/// The G-code that the path is read from.
struct PathText {
    text: Vec<u8>,
    job: Job,
    /// The reference's plan.
    speeds: Vec<MoveSpeeds>,
}

/// A job or a trace.
pub struct Simulation {
    steps: Steps,
    source: Source,
    profile: Profile,
    path: Option<PathText>,
    filament_mm2: f64,
    /// True to measure ringing also as a part of the unfiltered plan's.
    has_relative_ringing: bool,
}

/// Measures of a simulation, with samples for pictures.
pub type Measured = (Report, Option<Snapshots>);

impl Simulation {
    /// Reads a job or the beginning of a trace.
    ///
    /// # Errors
    /// The file cannot be read, is neither a job nor a trace, or the path belongs to another job.
    pub fn open(
        file: &Path,
        profile: Profile,
        path: Option<&Path>,
        path_of_steps: bool,
    ) -> Result<Self, SimulationError> {
        check(&profile)?;
        let steps = steps_of(file)?;
        let mut text = None;
        let source = match &steps {
            Steps::Trace(_) => Source::Trace,
            Steps::Job(bytes) => {
                let mut input = Input::of_bytes(Arc::clone(bytes))?;
                if input.is_prepared() {
                    Source::Prepared
                } else {
                    if !path_of_steps {
                        text = Some(all_of(&mut input)?).filter(|text| says_path(text, &profile));
                    }
                    Source::GCode
                }
            }
        };
        if let Some(path) = path {
            let mut input = match steps_of(path)? {
                Steps::Trace(_) => return Err(SimulationError::PathIsNoText),
                Steps::Job(bytes) => Input::of_bytes(bytes)?,
            };
            if input.is_prepared() {
                return Err(SimulationError::PathIsNoText);
            }
            text = Some(all_of(&mut input)?);
        }
        let path = text.map(|text| planned(text, &profile)).transpose().map_err(SimulationError::Interpret)?;
        let diameter_mm = profile.extrusion.filament_diameter_10nm as f64 * 1e-5;
        let filament_mm2 = diameter_mm * diameter_mm * std::f64::consts::FRAC_PI_4;
        Ok(Self { steps, source, profile, path, filament_mm2, has_relative_ringing: true })
    }

    /// A job by its G-code.
    ///
    /// # Errors
    /// The path cannot be read from it.
    pub fn of_text(text: Vec<u8>, profile: Profile) -> Result<Self, SimulationError> {
        check(&profile)?;
        let steps = Steps::Job(text.as_slice().into());
        let path = Some(planned(text, &profile).map_err(SimulationError::Interpret)?);
        let filament_mm2 = filament_mm2(&profile);
        Ok(Self { steps, source: Source::GCode, profile, path, filament_mm2, has_relative_ringing: false })
    }

    /// The kind of the simulated file.
    pub const fn source(&self) -> Source {
        self.source
    }

    /// Returns true if the path comes from G-code, not from the steps.
    pub const fn has_path(&self) -> bool {
        self.path.is_some()
    }

    /// Returns the filters and the frame's frequencies that the options give for this job or trace.
    ///
    /// # Errors
    /// The options contradict each other, or mean nothing for it.
    pub fn filters(&self, words: &FilterWords) -> Result<SimulatedFilters, SimulationError> {
        Ok(words.of((self.source != Source::Trace).then_some(&self.profile))?)
    }

    /// Gives the machine of a job these filters of X and Y instead of its profile's.
    pub const fn set_filters(&mut self, shapers: [AxisShaper; 2]) {
        self.profile.motion.shapers = shapers;
    }

    /// Leaves `ringing.relative` out, and the time that it takes.
    pub const fn leave_out_relative_ringing(&mut self) {
        self.has_relative_ringing = false;
    }

    /// Plays the plan by another firmware's rules, with its filters, on a machine and measures it.
    /// A job that stops at a line is measured up to there, and the reason returned beside.
    ///
    /// # Errors
    /// There is no G-code to plan, the G-code of a trace stops, or the machine's numbers are out of
    /// range.
    pub fn by_rules(
        &self,
        machine: &Machine,
        by: ByRules,
        filters: &Filters,
    ) -> Result<(Measured, Option<JobError>), SimulationError> {
        let job = self.path.as_ref().map(|path| &path.job);
        let ByRulesPlan { plans, durations_s, after_own, stopped } =
            by_rules::planned(&self.text()?, job, &self.profile, by, self.filament_mm2);
        let path = match job {
            Some(job) => PathSource::of_job(job, durations_s, self.filament_mm2).may_join_moves(),
            None => PathSource::of_steps(self.filament_mm2),
        };
        let stopped = match (stopped, &self.steps) {
            (None, _) => None,
            (Some(error), Steps::Job(_)) => Some(error),
            (Some(error), Steps::Trace(_)) => return Err(SimulationError::Job(error)),
        };
        let header = match &self.steps {
            Steps::Trace(trace) => trace.header().clone(),
            Steps::Job(_) => machine::trace_header(&self.profile),
        };
        let mut steps = StepSimulation::new(header, machine, self.filament_mm2, path, Measures::with_snapshots())?;
        after_own.into_iter().for_each(|line| steps.own_moves_before(line));
        let time_s = steps.play_plans(&plans, filters)?;
        let (measures, _) = steps.finish()?;
        let (mut report, snapshots) = measures.finish(time_s);
        if self.has_relative_ringing {
            report.ringing = report.ringing.relative_to(&self.unfiltered(machine, &plans)?.ringing);
        }
        Ok(((report, snapshots), stopped))
    }

    /// The G-code: the job's own, else that of the path.
    fn text(&self) -> Result<Cow<'_, [u8]>, SimulationError> {
        match (&self.steps, &self.path) {
            (Steps::Job(bytes), _) if self.source == Source::GCode => {
                Ok(all_of(&mut Input::of_bytes(Arc::clone(bytes))?)?.into())
            }
            (_, Some(path)) => Ok(path.text.as_slice().into()),
            _ => Err(SimulationError::NothingToCompare),
        }
    }

    /// Measures plans without filters.
    fn unfiltered(&self, machine: &Machine, plans: &[Plan]) -> Result<Report, SimulationError> {
        let mut measures = Measures::default();
        let time_s = simulate(plans, &Filters::default(), machine, self.filament_mm2, &mut measures)?;
        Ok(measures.finish(time_s).0)
    }

    /// Plays the steps on a machine and measures them. A job that stops at a line is measured up to
    /// there, and the reason returned beside.
    ///
    /// # Errors
    /// The trace is damaged, the path belongs to another job, or the machine's numbers
    /// are out of range.
    pub fn run(
        self,
        machine: &Machine,
        mut look: impl FnMut(&JobProgress),
    ) -> Result<(Measured, Option<JobError>), SimulationError> {
        let unshaped = match &self.path {
            Some(PathText { job, speeds, .. }) if self.has_relative_ringing => {
                Some(self.unfiltered(machine, &Plan::of_job(job, speeds, self.filament_mm2))?)
            }
            _ => None,
        };
        let path = match &self.path {
            None => PathSource::of_steps(self.filament_mm2),
            Some(PathText { job, speeds, .. }) => {
                let path = PathSource::of_job(job, durations_s(job, speeds), self.filament_mm2);
                if self.profile.motion.filament_on_the_way { path.filament_on_the_way() } else { path }
            }
        };
        let measures = Measures::with_snapshots();
        let (steps, stopped) = match self.steps {
            Steps::Trace(reader) => {
                let header = reader.header().clone();
                let mut steps = StepSimulation::new(header, machine, self.filament_mm2, path, measures)?;
                for record in *reader {
                    steps.play(&record.map_err(trace_error)?)?;
                }
                (steps, None)
            }
            Steps::Job(bytes) => {
                let mut input = Input::of_bytes(bytes)?;
                let header = machine::trace_header(&self.profile);
                let steps = StepSimulation::new(header, machine, self.filament_mm2, path.may_end_early(), measures)?;
                let session = Session::print(
                    self.profile,
                    LOOK_AHEAD_BLOCKS,
                    StepsObserver::new(steps),
                    JobReplies::new(|_: &str| {}),
                );
                let mut printer = session.printer();
                let mut done = JobProgress::default();
                let outcome = if input.is_prepared() {
                    session.run(gpre::play(&mut input, &self.profile, &mut printer, &mut done, |done| look(done)))
                } else {
                    session.run(job::run(&mut input, &mut printer, &mut done, |done| look(done)))
                };
                (session.into_observer().finish()?, outcome.err())
            }
        };
        let (measures, time_s) = steps.finish()?;
        let (mut report, snapshots) = measures.finish(time_s);
        if let Some(unshaped) = unshaped {
            report.ringing = report.ringing.relative_to(&unshaped.ringing);
        }
        Ok(((report, snapshots), stopped))
    }
}

/// Rejects a profile with skew or backlash, which the simulated machine does not have.
fn check(profile: &Profile) -> Result<(), SimulationError> {
    if profile.skew != Skew::NONE {
        return Err(SimulationError::Skew);
    }
    if profile.backlash.is_some() { Err(SimulationError::Backlash) } else { Ok(()) }
}

fn trace_error(error: TraceError) -> SimulationError {
    SimulationError::Steps(StepsError::Trace(error))
}

/// A file by its first byte: a trace is streamed, a job is read whole.
fn steps_of(file: &Path) -> Result<Steps, SimulationError> {
    if input::is_standard_input(file) {
        let bytes = input::bytes(file)?;
        return Ok(match bytes.first() {
            Some(&TRACE_START) => trace(Cursor::new(bytes))?,
            _ => Steps::Job(bytes),
        });
    }
    let mut opened = BufReader::new(File::open(file).map_err(InputError::Read)?);
    let mut start = [0];
    let length = opened.read(&mut start).map_err(InputError::Read)?;
    let mut bytes = start[..length].to_vec();
    if bytes == [TRACE_START] {
        return trace(Cursor::new(bytes).chain(opened));
    }
    opened.read_to_end(&mut bytes).map_err(InputError::Read)?;
    Ok(Steps::Job(bytes.into()))
}

fn trace(bytes: impl Read + 'static) -> Result<Steps, SimulationError> {
    let bytes: Box<dyn Read> = Box::new(bytes);
    Ok(Steps::Trace(Box::new(TraceReader::new(bytes).map_err(trace_error)?)))
}

fn all_of(input: &mut Input) -> Result<Vec<u8>, SimulationError> {
    let mut text = Vec::new();
    input.read_to_end(&mut text).map_err(InputError::Read)?;
    Ok(text)
}

/// Returns true if the lines of a text say where the nozzle goes, without what the
/// desk stands in for.
fn says_path(text: &[u8], profile: &Profile) -> bool {
    if !macros::has_names(text) {
        return true;
    }
    let session = Session::estimate(*profile, LOOK_AHEAD_BLOCKS, JobReplies::new(|_: &str| {}));
    let mut done = JobProgress::default();
    // A job that stops does so again when it is simulated.
    let _ = session.run(job::run(&mut &text[..], &mut session.printer(), &mut done, |_| {}));
    !done.stands_in
}

/// The moves of a text, and the reference's plan of them.
fn planned(text: Vec<u8>, profile: &Profile) -> Result<PathText, InterpretError> {
    let job = interpret(&text, &reference_profile(profile), InterpretOptions::default())?;
    let speeds = plan(&job, None).moves.iter().map(|one| MoveSpeeds::from(one.law)).collect();
    Ok(PathText { text, job, speeds })
}
