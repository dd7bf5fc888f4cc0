//! Records a print for the page of `ferrostep show`.

use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_host::printable;
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::surface::Mesh;
use ferrostep_planner::{Move, StepObserver, TICKS_PER_SECOND};
use ferrostep_printer::{HeaterStatus, Heating, Ports, Printer, Profile, Replies};
use ferrostep_session::command_code::code;
use ferrostep_session::desk::{Desk, Figures, LOOK_AHEAD_BLOCKS, LimitFactors, MotionState, QueueMachine};
use ferrostep_session::gpre;
use ferrostep_session::input::{self, Input};
use ferrostep_session::job::{self, JobError, JobProgress, Onlooker};
use ferrostep_session::limit_shares::LimitShare;
use ferrostep_session::macros::Macros;
use ferrostep_session::record::Observer;
use ferrostep_session::remarks::{Remark, RemarkKind};
use ferrostep_session::report::Stop;
use ferrostep_session::rules::{ByRules, Piece, PlanObserver};
use ferrostep_session::unread::Unread;
use ferrostep_session::watch::Watch;
use ferrostep_session::{JobReplies, Session};
use ferrostep_show::{
    Chamber, ExecutedMove, Finding, Job, LimitTime, LineState, Machine, Marked, Outcome, Phase, PlannedMove, Recorder,
    Recording, Remarked, Rest, RestState, RulesShown, SourceText, Surface, Temperature, Text, Weight,
};
use ferrostep_simulator::nozzle::{NozzleError, NozzleSettings};

use crate::simulation::filament_mm2;
use crate::without_commands::{Dropped, WithoutCommands};

/// Maximum number of nodes of a page: about seven megabytes.
pub const MAX_NODES: usize = 700_000;
/// Maximum number of bytes of the job's text in a page: about two megabytes of it, packed.
pub const MAX_TEXT_BYTES: usize = 8 << 20;

/// Commands that home or probe.
const HOMING: [&str; 4] = ["G28", "G29", "G30", "G38"];
/// Commands that change the surface that Z follows.
const MEASURING: [&str; 2] = ["G29", "M420"];
/// Commands that wait for a heater.
const HEATING: [&str; 4] = ["M109", "M116", "M190", "M191"];

/// A record that its observer and the lines of the job share.
type Shared = Rc<RefCell<Recorder>>;

/// Passes the steps of a print to the record as they are made.
struct ShowObserver(Shared);

impl StepObserver for ShowObserver {
    #[inline]
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.0.borrow_mut().stepped(tick, axes, directions);
    }
}

impl Observer for ShowObserver {
    fn planned(&mut self, taken: &Move, slowed_moves: u64) {
        self.0.borrow_mut().planned(&PlannedMove {
            target_mm: taken.target_10nm.map(|units| units as f64 / UNITS_PER_MM as f64),
            filament_mm: taken.filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64,
            line: taken.line,
            ends_move: taken.ends_move,
            slowed_moves,
        });
    }

    fn redefined(&mut self, tick: u64, motor_steps: [i64; 4]) {
        self.0.borrow_mut().redefined(tick, motor_steps);
    }

    fn move_ended(&mut self, tick: u64, line: u32) {
        self.0.borrow_mut().move_ended(tick, line);
    }
}

/// Hands the moves that another firmware's rules have planned to the record.
struct PlanShown {
    recorder: Shared,
    limits: Rc<RefCell<Vec<&'static str>>>,
}

impl PlanObserver for PlanShown {
    fn ran(&mut self, piece: &Piece) {
        let limits = &mut *self.limits.borrow_mut();
        let phases = piece.phases.map(|phase| {
            let known = limits.iter().position(|limit| *limit == phase.limit);
            let index = known.unwrap_or_else(|| {
                limits.push(phase.limit);
                limits.len() - 1
            });
            let limit = u8::try_from(index + 1).unwrap_or(0);
            Phase { seconds: phase.seconds, speeds_mm_per_s: phase.speeds_mm_per_s, limit }
        });
        let Piece { line, start_mm, displacement_mm, feed_mm_per_s, .. } = *piece;
        self.recorder.borrow_mut().ran(&ExecutedMove { line, start_mm, displacement_mm, feed_mm_per_s, phases });
    }

    fn stands(&mut self, tick: u64, position_mm: [f64; 3]) {
        self.recorder.borrow_mut().stands(tick, position_mm);
    }
}

/// Notes the state of the file at each line.
struct Lines<'a> {
    recorder: &'a RefCell<Recorder>,
    /// The machine whose Z follows the bed; `None` where no steps are made.
    machine: Option<&'a RefCell<QueueMachine>>,
    text: Rc<RefCell<Text>>,
    state: LineState,
    line: u32,
    /// True if the line may measure the bed.
    measures: bool,
    /// True if Z follows the measured bed.
    follows: bool,
    heats: &'a RefCell<Option<bool>>,
    /// The lines after the one that stopped the job.
    unread: Option<Unread>,
}

impl<P: Ports> Onlooker<P> for Lines<'_> {
    fn begins(&mut self, _: &Printer<'_, P>, line: u32, text: &str) {
        self.line = line;
        let Marked { layer, feature, height_mm, width_mm } = self.text.borrow_mut().at(line);
        let is_one_of = |commands: &[&str]| commands.iter().any(|command| command.eq_ignore_ascii_case(code(text)));
        self.state = LineState { layer, feature, height_mm, width_mm, homes: is_one_of(&HOMING), ..self.state };
        self.measures = is_one_of(&MEASURING);
        // The lines of a macro may heat or not.
        let is_macro = code(text).bytes().take(2).all(|byte| byte.is_ascii_alphabetic() || byte == b'_');
        *self.heats.borrow_mut() = (!is_macro).then(|| is_one_of(&HEATING));
        let mut recorder = self.recorder.borrow_mut();
        recorder.executes(line);
        // The first chords of an arc may be executed before all of it is planned.
        if self.state.homes || self.machine.is_none() {
            recorder.note_state(line, self.state);
        }
    }

    fn ended(&mut self, printer: &Printer<'_, P>) {
        self.state.feed_mm_per_s = printer.feed_mm_per_s() as f32;
        let (tool, nozzle_10nm) = printer.tool_in_use();
        (self.state.tool, self.state.nozzle_mm) = (tool, nozzle_10nm.map(millimetres));
        self.follow_bed(nozzle_10nm);
        self.recorder.borrow_mut().note_state(self.line, self.state);
    }

    fn stopped(&mut self, unread: Unread) {
        self.unread = Some(unread);
    }
}

impl Lines<'_> {
    /// Adds to the record the surface that Z follows, if the line has changed it; the motors
    /// are at rest then.
    fn follow_bed(&mut self, nozzle_10nm: [i64; 3]) {
        let Some(machine) = self.machine else { return };
        let mut machine = machine.borrow_mut();
        let follows = machine.follows_bed();
        if std::mem::replace(&mut self.follows, follows) == follows && !(self.measures && machine.is_idle()) {
            return;
        }
        let mesh = if follows { machine.mesh().map(|mesh| mesh.clone()) } else { None };
        drop(machine);
        let surface = mesh.map(|mesh| surface(mesh, nozzle_10nm));
        self.recorder.borrow_mut().follow(surface);
    }
}

/// The surface of a mesh below a nozzle at this offset from the machine's place.
fn surface(mesh: Mesh, nozzle_10nm: [i64; 3]) -> Surface {
    let fade_mm = millimetres(mesh.fade_10nm().into());
    Surface::new(move |[x, y, z]| {
        let [x, y] = [(x, 0), (y, 1)].map(|(mm, axis)| mm * UNITS_PER_MM as f64 + nozzle_10nm[axis] as f64);
        let height_mm = mesh.height_mm([x, y]);
        if fade_mm <= 0.0 {
            return height_mm;
        }
        // The motors are at z = plan + height (1 - plan / fade).
        let planned_mm = ((z - height_mm) / (1.0 - height_mm / fade_mm)).min(fade_mm);
        height_mm * (1.0 - planned_mm / fade_mm).min(1.0)
    })
}

/// The state in which the rest of a job begins.
fn rest_state<P: Ports>(printer: &Printer<'_, P>) -> RestState {
    let state = printer.gcode_state();
    let (tool, nozzle_10nm) = printer.tool_in_use();
    RestState {
        position_mm: std::array::from_fn(|axis| millimetres(state.machine_10nm[axis] + nozzle_10nm[axis])),
        logical_mm: state.logical_10nm.map(millimetres),
        is_relative: state.is_relative,
        is_extruder_relative: state.is_extruder_relative,
        is_inches: state.is_in_inches(),
        tool,
    }
}

fn millimetres(units_10nm: i64) -> f64 {
    units_10nm as f64 / UNITS_PER_MM as f64
}

/// A print that has been recorded.
pub struct Shown {
    /// The motion.
    pub recording: Recording,
    /// The job's text.
    pub text: Text,
    /// The counts.
    pub figures: Figures,
    /// The job's progress at its end.
    pub done: JobProgress,
    /// Moves.
    pub moves: u64,
    /// Net filament.
    pub filament_mm: f64,
    /// Remarks on lines and on the end.
    pub remarks: Vec<Remark>,
    /// The rules of another firmware that planned the motion.
    pub rules: Option<RulesShown>,
    /// Error that stopped the job early.
    pub stopped: Option<JobError>,
}

/// The machine of a profile, as the record sees it.
fn machine(profile: &Profile, max_nodes: usize) -> Machine {
    let [a, b, c, extruder] = profile.steps_per_mm.map(|steps| 1.0 / steps.to_f64());
    let columns = [[a, 0.0, 0.0], [0.0, b, 0.0], [0.0, 0.0, c]].map(|motors| profile.kinematics.position(motors));
    Machine {
        tick_hz: TICKS_PER_SECOND,
        mm_per_step: std::array::from_fn(|axis| columns.map(|column| column[axis])),
        filament_mm_per_step: extruder,
        filament_mm2: filament_mm2(profile),
        nozzle: NozzleSettings::default(),
        max_nodes,
    }
}

/// Prints a job on the virtual board, or plans it by another firmware's rules, and records it;
/// `look` is called from time to time. A job that stops is recorded up to there.
///
/// # Errors
/// The nozzle's numbers are out of range.
pub fn record(
    profile: Profile,
    by: Option<ByRules>,
    input: &mut Input,
    max_nodes: usize,
    replies: JobReplies<'_>,
    look: impl FnMut(&JobProgress, &Figures),
) -> Result<Shown, NozzleError> {
    record_without(&Dropped::new(Vec::new()), profile, by, input, max_nodes, replies, look)
}

/// Records a job as [`record`] does, without some of its commands.
pub(crate) fn record_without(
    dropped: &Dropped,
    profile: Profile,
    by: Option<ByRules>,
    input: &mut Input,
    max_nodes: usize,
    replies: JobReplies<'_>,
    look: impl FnMut(&JobProgress, &Figures),
) -> Result<Shown, NozzleError> {
    let machine = machine(&profile, max_nodes);
    let Some(by) = by else {
        let recorder = Rc::new(RefCell::new(Recorder::new(machine)?));
        let observer = ShowObserver(Rc::clone(&recorder));
        let session = Session::print(profile, LOOK_AHEAD_BLOCKS, observer, replies);
        let shown = run(&session, &recorder, Some(session.desk().state()), dropped, input, look);
        drop(session);
        return Ok(finished(shown, recorder));
    };
    let recorder = Rc::new(RefCell::new(Recorder::of_plan(machine)?));
    let limits = Rc::default();
    let session = Session::by_rules(profile, by, replies);
    session.desk().observe(Box::new(PlanShown { recorder: Rc::clone(&recorder), limits: Rc::clone(&limits) }));
    let mut shown = run(&session, &recorder, None, dropped, input, look);
    if let Some(report) = session.desk().rules() {
        report.keep(&mut shown.remarks);
        let times =
            report.limits.iter().map(|&LimitShare { limit, seconds, moves }| LimitTime { limit, seconds, moves });
        shown.rules = Some(RulesShown { name: report.name, limits: limits.take(), times: times.collect() });
    }
    drop(session);
    Ok(finished(shown, recorder))
}

/// A print with its record, which no session fills any more.
fn finished(shown: Shown, recorder: Shared) -> Shown {
    match Rc::into_inner(recorder) {
        Some(recorder) => Shown { recording: recorder.into_inner().finish(), ..shown },
        None => unreachable!("the session that held the other one is gone"),
    }
}

/// Executes a job on a session that fills the record.
fn run<D: Desk>(
    session: &Session<D, JobReplies<'_>>,
    recorder: &RefCell<Recorder>,
    machine: Option<&RefCell<QueueMachine>>,
    dropped: &Dropped,
    input: &mut Input,
    mut look: impl FnMut(&JobProgress, &Figures),
) -> Shown {
    let mut printer = session.printer();
    let mut done = JobProgress::default();
    let remarks = session.replies().remarks();
    let mut watch = Watch::new(session.profile(), remarks).with_refusals(session.desk().refusals());
    let heats = RefCell::new(None);
    let between = |session: &Session<D, JobReplies<'_>>| note_time(session, recorder, *heats.borrow());
    let look = |done: &JobProgress| look(done, &session.figures());
    let (outcome, text) = if input.is_prepared() {
        let played = gpre::play_from(0, input, session.profile(), &mut printer, &mut done, look);
        (session.run_with(played, between), Rc::default())
    } else {
        let mut source = SourceText::new(WithoutCommands::new(input, dropped), MAX_TEXT_BYTES);
        let text = source.text();
        let state = LineState::default();
        let mut lines = Lines {
            recorder,
            machine,
            text: Rc::clone(&text),
            state,
            line: 0,
            measures: false,
            follows: false,
            heats: &heats,
            unread: None,
        };
        let mut onlookers = (&mut watch, &mut lines);
        let run = job::run_watched(&mut source, &mut printer, &mut done, Macros::chosen(), &mut onlookers, look);
        let outcome = session.run_with(run, between);
        watch.end_of_text(outcome.is_ok());
        if let (Err(error), Some(unread)) = (&outcome, lines.unread.take()) {
            let mut rest = Rest::new(rest_state(&printer), filament_mm2(session.profile()));
            let mut follow = |line, words: &str| {
                let marked = text.borrow_mut().at(line);
                rest.follow(line, words, marked, |node| recorder.borrow_mut().rest(node));
            };
            // The line that was refused also asks for a place, unless it is damaged.
            if let JobError::Line { line, text, .. } = error
                && *line == lines.line
            {
                follow(*line, text);
            }
            unread.read(&mut source, follow);
        }
        (outcome, text)
    };
    watch.end(&session.heating(), outcome.is_ok());
    let tally = printer.tally();
    let (figures, remarks) = (session.figures(), session.replies().remarks().to_vec());
    Shown {
        recording: Recording::default(),
        text: text.take(),
        figures,
        done,
        moves: tally.moves,
        filament_mm: tally.filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64,
        remarks,
        rules: None,
        stopped: outcome.err(),
    }
}

/// Notes waits and temperatures after time has passed.
fn note_time<D: Desk, R: Replies>(session: &Session<D, R>, recorder: &RefCell<Recorder>, heats: Option<bool>) {
    let now_s = session.clock().now_ns() as f64 * 1e-9;
    let state = session.desk().state();
    let (tick, fan_power) = (state.tick(), state.fan_demand().powers[FanOutput::Part.index()]);
    let heating = session.heating();
    let status = [Heater::Nozzle, Heater::Bed].map(|heater| heating.status(heater));
    let temperature = Temperature {
        time_s: now_s,
        celsius: status.map(|status| status.celsius),
        target_celsius: status.map(|status| status.target_celsius),
        chamber: heating.chamber_is_heated().map(|_| {
            let HeaterStatus { celsius, target_celsius, .. } = heating.status(Heater::Chamber);
            Chamber { celsius, target_celsius }
        }),
        fan_power,
    };
    // A prepared job does not say what it waits for.
    let heats = heats.unwrap_or_else(|| status.iter().any(|status| status.target_celsius > status.celsius + 1.0));
    let mut recorder = recorder.borrow_mut();
    recorder.note_temperature(temperature);
    recorder.waited(tick, now_s - tick as f64 / f64::from(TICKS_PER_SECOND), heats);
}

/// Other limits with which a file is estimated, and words for them.
const QUESTIONS: [(&str, LimitFactors); 4] = [
    ("twice the acceleration", LimitFactors { acceleration: 2.0, corners: 1.0 }),
    ("four times the acceleration", LimitFactors { acceleration: 4.0, corners: 1.0 }),
    ("half the acceleration", LimitFactors { acceleration: 0.5, corners: 1.0 }),
    ("corners rounded four times as far", LimitFactors { acceleration: 1.0, corners: 4.0 }),
];

/// Estimates a file with other limits, each in a thread: words for them, and the print's time, s.
/// Empty where the print stops or the file cannot be read.
pub fn chances(profile: Profile, file: &Path) -> Vec<(String, f64)> {
    std::thread::scope(|scope| {
        let asked = QUESTIONS.map(|(words, factors)| (words, scope.spawn(move || estimate(profile, file, factors))));
        let answers = asked.map(|(words, thread)| Some((words.to_owned(), thread.join().ok()??)));
        answers.into_iter().flatten().collect()
    })
}

/// Estimates as [`chances`] does, one after the other: for programs without threads.
pub fn chances_in_turn(profile: Profile, file: &Path) -> impl Iterator<Item = (String, f64)> {
    QUESTIONS
        .into_iter()
        .filter_map(move |(words, factors)| Some((words.to_owned(), estimate(profile, file, factors)?)))
}

/// Time of a file's print with other limits, s.
fn estimate(profile: Profile, file: &Path, factors: LimitFactors) -> Option<f64> {
    let mut input = Input::open(file).ok().filter(|input| !input.is_prepared())?;
    let replies = JobReplies::new(|_: &str| {});
    let session = Session::estimate_with(profile, LOOK_AHEAD_BLOCKS, factors, replies);
    let mut printer = session.printer();
    let mut done = JobProgress::default();
    session.run(job::run(&mut input, &mut printer, &mut done, |_| {})).ok()?;
    Some(session.figures().print_time_s)
}

impl Shown {
    /// Returns the page's facts besides the motion. `file`: the job's name; `slicer_time_s`: the
    /// slicer's estimate, used if the job's text has none.
    pub fn job(&self, file: &Path, profile: &Profile, slicer_time_s: Option<f64>, chances: Vec<(String, f64)>) -> Job {
        Job {
            file: file.file_name().map_or_else(|| input::name(file), |file| printable::name(Path::new(file))),
            profile: profile.name.to_owned(),
            version: ferrostep_session::VERSION.to_owned(),
            print_time_s: self.figures.print_time_s,
            slicer_time_s: self.done.slicer_time_s.or(slicer_time_s),
            filament_mm: self.filament_mm,
            filament_mm2: filament_mm2(profile),
            lines: self.done.lines,
            moves: self.moves,
            travel_mm: [profile.lower_end_10nm, profile.size_10nm].map(|ends| ends.map(millimetres)),
            max_flow_mm3_per_s: profile.max_volumetric_flow_mm3_per_s.map(f64::from),
            nozzle_time_constant_s: NozzleSettings::default().time_constant_s,
            rules: self.rules.clone(),
            chances,
            findings: self.findings(),
        }
    }

    /// Returns the findings that the page lists, the most important first.
    pub fn findings(&self) -> Vec<Finding> {
        let stopped = self.stopped.as_ref().map(|error| (error.to_string(), Stop::from(error).line));
        let remarks = self.remarks.iter().map(|remark| Remarked {
            message: &remark.message,
            count: remark.count,
            line: remark.lines.first().copied(),
            weight: match remark.kind {
                RemarkKind::SoftLimit => Weight::LostMoves,
                RemarkKind::Corner | RemarkKind::Foreign => Weight::Note,
                RemarkKind::NoEffect | RemarkKind::Unknown => Weight::WithoutEffect,
                _ => Weight::Warning,
            },
        });
        let outcome = Outcome { stopped, remarks: remarks.collect(), slowed_moves: self.figures.slowed_moves };
        outcome.findings(&self.recording.totals)
    }
}
