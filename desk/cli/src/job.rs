//! The job of a command: opened, executed on a session, and summed up.

use std::cell::Cell;
use std::path::Path;
use std::process::ExitCode;
use std::rc::Rc;
use std::time::Instant;

use ferrostep_host::printable;
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::Profile;
use ferrostep_profiles::PlannedBy;
use ferrostep_session::desk::{Desk, LineEnds, MotionState};
use ferrostep_session::gpre;
use ferrostep_session::input::{self, Input};
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::macros::Macros;
use ferrostep_session::parts::Parts;
use ferrostep_session::remarks::Remark;
use ferrostep_session::report::{Motors, Stop, Summary};
use ferrostep_session::took::Took;
use ferrostep_session::watch::Watch;
use ferrostep_session::{JobReplies, Session};

use crate::arguments::JobArguments;
use crate::machine::Machine;
use crate::outcome::{exit_code, result};
use crate::progress::Progress;

/// Maximum number of the machine's notices that are shown; a broken file could cause one a line.
const MAX_NOTICES: u32 = 20;

/// The machine, of this profile if one is named, and the open file of a job.
pub fn open(job: &JobArguments, named: Option<&str>) -> Result<(Profile, Input), String> {
    let input = open_file(job)?;
    let machine = Machine::of_job(named, Some(PlannedBy::Own), &job.file, &input)?;
    Ok((machine.ruled.profile, input))
}

/// The open file of a job.
pub fn open_file(job: &JobArguments) -> Result<Input, String> {
    Input::open(&job.file).map_err(|error| format!("{}: {error}", input::name(&job.file)))
}

/// Shows the machine's messages: errors always, notices up to a maximum.
pub fn replies(progress: &Progress) -> JobReplies<'_> {
    let shown = Cell::new(0);
    JobReplies::new(move |text: &str| {
        shown.set(shown.get() + 1);
        match shown.get() {
            // An error says why the machine stopped, and is shown after any number of notices.
            _ if text.starts_with("Error:") => progress.say(text),
            ..=MAX_NOTICES => progress.say(text),
            count if count == MAX_NOTICES + 1 => progress.say("(further notices of the machine are left out)"),
            _ => {}
        }
    })
}

/// Returns exit status 1 on any remark that is not harmless, for `--strict`.
pub fn strict(file: &Path, remarks: &[Remark]) -> ExitCode {
    let remarks: Vec<&Remark> = remarks.iter().filter(|remark| !remark.kind.is_harmless()).collect();
    match remarks[..] {
        [] => ExitCode::SUCCESS,
        [first, ..] => {
            let name = printable::name(file);
            let count = match remarks.len() {
                1 => "1 remark".to_owned(),
                count => format!("{count} remarks"),
            };
            exit_code(Err(format!("{name}: {count}, and none expected (--strict): {first}")))
        }
    }
}

/// Runs the job, a prepared one from a frame on, and prints its summary. `explain` tells, of the
/// estimated time, what would explain a measured one.
pub fn run<D: Desk>(
    job: &JobArguments,
    mut input: Input,
    session: &Session<D, JobReplies<'_>>,
    progress: &Progress,
    from: u32,
    explain: impl FnOnce(f64) -> Result<Option<Took>, String>,
) -> ExitCode {
    let started = Instant::now();
    let profile = session.profile();
    let mut printer = session.printer();
    let mut done = JobProgress::default();
    let place = input.place();
    let look = |job: &JobProgress| progress.show(place.share(), job, || session.figures());
    let mut watch = Watch::new(profile, session.replies().remarks()).with_refusals(session.desk().refusals());
    let ends = Rc::new(LineEnds::default());
    let follows = job.json && !input.is_prepared() && session.desk().follow_lines(Rc::clone(&ends));
    let mut parts =
        follows.then(|| Parts::new(ends, || (session.desk().now_ns() as f64 * 1e-9, session.desk().state().tick())));
    let outcome = if input.is_prepared() {
        // A prepared job is planned already, and most of it fits into the look-ahead: only its
        // execution takes time.
        let job = gpre::play_from(from, &mut input, profile, &mut printer, &mut done, look);
        session.run_with(job, |session| progress.pass_time(|| session.figures()))
    } else {
        let mut onlookers = (&mut watch, &mut parts);
        let run = job::run_watched(&mut input, &mut printer, &mut done, Macros::chosen(), &mut onlookers, look);
        let outcome = session.run(run);
        watch.end_of_text(outcome.is_ok());
        outcome
    };
    watch.end(&session.heating(), outcome.is_ok());
    let wall_s = started.elapsed().as_secs_f64();
    progress.end();

    let figures = session.figures();
    let report = session.desk().rules();
    let mut remarks = session.replies().remarks().to_vec();
    if let Some(report) = &report {
        report.keep(&mut remarks);
    }
    let (rules, limits) = report.map(|report| (report.name, report.limits)).unzip();
    let tally = printer.tally();
    let took = match outcome {
        Ok(()) => explain(figures.print_time_s),
        // A job that stops has no whole time to compare with.
        Err(_) => Ok(None),
    };
    let took = match took {
        Ok(took) => took,
        Err(problem) => return exit_code(Err(format!("{}: {problem}", input::name(&job.file)))),
    };
    let summary = Summary {
        file: job.file.to_string_lossy().into_owned(),
        profile: profile.name.to_owned(),
        lines: done.lines,
        moves: tally.moves,
        unknown_commands: session.replies().unknown_commands(),
        clamped_moves: tally.clamped_moves,
        print_time_s: figures.print_time_s,
        motion_time_s: figures.motion_time_s,
        rules,
        limits,
        took,
        filament_mm: tally.filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64,
        position_mm: printer.logical_10nm().map(|length| length as f64 / UNITS_PER_MM as f64).into(),
        motors: D::MAKES_STEPS.then(|| Motors::from(&figures)),
        wall_s,
        realtime_factor: figures.motion_time_s / wall_s.max(1e-9),
        layers: done.layers,
        parts: parts.map(Parts::finish),
        slicer: input.description().map(|description| description.figures.clone()),
        slicer_time_s: done.slicer_time_s.or(input.description().and_then(|said| Some(said.figures.time_s?.into()))),
        remarks: Some(remarks),
        stopped: outcome.as_ref().err().map(Stop::from),
    };
    let code = result(job.json.then_some(&summary), || format!("{summary}\n"));
    match outcome {
        Ok(()) if job.strict && code == ExitCode::SUCCESS => {
            strict(&job.file, summary.remarks.as_deref().unwrap_or_default())
        }
        Ok(()) => code,
        Err(error) => exit_code(Err(format!("{}: {error}", input::name(&job.file)))),
    }
}
