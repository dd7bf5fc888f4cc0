//! The `ferrostep` command.

mod arguments;
mod black_boxing;
mod calibrating;
mod comparing;
mod importing;
mod manual;
mod outcome;
mod progress;
mod sending;
#[cfg(unix)]
mod serving;
#[cfg(unix)]
mod serving_image;
#[cfg(unix)]
mod serving_page;
mod showing;
mod simulating;
mod sweeping;
mod terminal;
mod waveform;

use std::cell::Cell;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use ferrostep_analysis::method_comparison;
use ferrostep_gpre::Encoding;
use ferrostep_host::printable;
use ferrostep_papers::tables::{Chapter, Paper};
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::Profile;
use ferrostep_session::desk::{Desk, LOOK_AHEAD_BLOCKS};
use ferrostep_session::gpre::{self, InspectError, PrepareError, PreparedSummary, Shown};
use ferrostep_session::input::{self, Input};
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::output::{Accepted, Output, OutputError, Protected};
use ferrostep_session::record::{Recorder, TraceWriter, VcdWriter, Window};
use ferrostep_session::remarks::{Remark, RemarkKind};
use ferrostep_session::report::{Motors, Stop, Summary};
use ferrostep_session::watch::Watch;
use ferrostep_session::{JobReplies, Session};

use arguments::{Arguments, Command, Format, JobArguments};
use outcome::{exit_code, result};
use progress::Progress;
use terminal::tell;
use waveform::Edge;

/// Maximum number of the machine's notices that are shown; a broken file could cause one a line.
const MAX_NOTICES: u32 = 20;

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(answer) => return outcome::of_arguments(&answer),
    };
    input::choose_plate(arguments.command.plate());
    let outcome = match arguments.command {
        Command::Print { job, look_ahead, from_frame, trace, vcd, from, to } => {
            let vcd = vcd.as_deref().map(|path| (path, from, to));
            print(&job, look_ahead.map(|blocks| blocks as usize), from_frame, trace.as_deref(), vcd)
        }
        Command::Preprocess { job, out, format } => preprocess(&job, &out, format),
        Command::Inspect { file, items, entries } => {
            let shown = match (items, entries) {
                (true, _) => Shown::Items,
                (false, true) => Shown::Entries,
                (false, false) => Shown::Frames,
            };
            inspect(&file, shown)
        }
        Command::Send(arguments) => sending::run(&arguments),
        Command::Ports => sending::list(),
        Command::Blackbox(arguments) => black_boxing::run(&arguments),
        #[cfg(unix)]
        Command::Serve(arguments) => match &arguments.board {
            Some(board) => serving_image::run(board, &arguments),
            None => serving::run(&arguments),
        },
        Command::Estimate { job, error_budget: Some(values), simulate } => sweeping::budgets(job, values, simulate),
        Command::Estimate { job, .. } => estimate(&job),
        Command::Sweep(arguments) => sweeping::run(&arguments),
        Command::Compare(arguments) => comparing::run(&arguments),
        Command::Show(arguments) => showing::run(&arguments),
        Command::Simulate(arguments) => simulating::run(&arguments),
        Command::Calibrate { calibration } => calibrating::run(&calibration),
        Command::Import { file, moonraker, marlin, baud, out, json, all, assume } => {
            importing::Source::of(file, moonraker, marlin, baud).and_then(|source| {
                importing::run(&importing::Arguments { source, out: out.as_deref(), json, all, assume })
            })
        }
        Command::Completions { shell } => manual::completions(shell),
        Command::Man { out } => manual::pages(out.as_deref()),
        Command::Papers { compare: Some(file), profile, json, .. } => compare(&file, &profile, json),
        Command::Papers { paper, json, svg, .. } => papers(paper.map(Paper::from), json, svg.as_deref()),
    };
    // Exit status 2, as for wrong arguments: nothing was started.
    outcome.unwrap_or_else(|reason| {
        tell(format_args!("error: {reason}"));
        ExitCode::from(2)
    })
}

fn papers(paper: Option<Paper>, json: bool, folder: Option<&Path>) -> Result<ExitCode, String> {
    let papers = paper.map_or_else(|| Paper::ALL.to_vec(), |paper| vec![paper]);
    let chapters: Vec<_> = papers.into_iter().map(Paper::chapter).collect();
    if let Some(folder) = folder {
        for chapter in &chapters {
            for path in chapter.draw(folder).map_err(|error| error.to_string())? {
                tell(printable::name(&path));
            }
        }
    }
    Ok(result(json.then(|| serde_json::json!({ "papers": chapters })), || {
        chapters.iter().map(Chapter::text).collect::<Vec<_>>().join("\n")
    }))
}

fn compare(file: &Path, profile: &str, json: bool) -> Result<ExitCode, String> {
    let profile = ferrostep_profiles::load(profile).map_err(|error| error.to_string())?;
    let bar = progress::bar(method_comparison::ways().count() as u64, "{bar:20} {pos}/{len} {wide_msg}");
    let table = method_comparison::compare(file, &profile, |interpolation, acceleration| {
        bar.set_message(format!("{}, {}", interpolation.name(), acceleration.name()));
        bar.inc(1);
    });
    bar.finish_and_clear();
    let table = table.map_err(|error| format!("{}: {error}", input::name(file)))?;
    Ok(result(json.then(|| serde_json::json!({ "choices": table })), || table.text()))
}

/// The profile and the open file of a job.
fn open(job: &JobArguments) -> Result<(Profile, Input), String> {
    let profile = ferrostep_profiles::load(&job.profile).map_err(|error| error.to_string())?;
    let input = Input::open(&job.file).map_err(|error| format!("{}: {error}", input::name(&job.file)))?;
    Ok((profile, input))
}

/// The files that a job is read from: no output may replace them.
fn inputs<'a>(job: &'a Path, profile: &'a str) -> Vec<Protected<'a>> {
    let mut inputs = vec![Protected { path: job, what: "the job to be read" }];
    inputs.extend(profile_file(profile));
    inputs
}

/// The file of a profile, if it is not built in.
fn profile_file(profile: &str) -> Option<Protected<'_>> {
    let is_file = ferrostep_profiles::builtin_text(profile).is_none();
    is_file.then(|| Protected { path: Path::new(profile), what: "the profile" })
}

fn estimate(job: &JobArguments) -> Result<ExitCode, String> {
    let (profile, input) = open(job)?;
    if input.is_prepared() {
        return Err(format!(
            "{}: this is a prepared job, and estimate takes G-code: `ferrostep inspect` shows a prepared job's time",
            input::name(&job.file)
        ));
    }
    let progress = Progress::new();
    let session = Session::estimate(profile, LOOK_AHEAD_BLOCKS, replies(&progress));
    Ok(run(job, input, &session, &progress, 0))
}

fn print(
    job: &JobArguments,
    look_ahead: Option<usize>,
    from_frame: Option<u32>,
    trace: Option<&Path>,
    vcd: Option<(&Path, Option<Edge>, Option<Edge>)>,
) -> Result<ExitCode, String> {
    let window = vcd.map(|(_, from, to)| waveform::window(&job.file, from, to)).transpose()?.unwrap_or(Window::ALL);
    let (profile, input) = open(job)?;
    let named = job.file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gpre"));
    match (named, input.is_prepared()) {
        (true, false) => tell(format_args!(
            "note: {}: the name says prepared job, the content is G-code: printing it as G-code",
            input::name(&job.file)
        )),
        (false, true) => {
            tell(format_args!("note: {}: the content is a prepared job: printing it as that", input::name(&job.file)))
        }
        _ => {}
    }
    if from_frame.is_some() && !input.is_prepared() {
        return Err(format!(
            "{}: this is G-code, and --from-frame needs a prepared job: `ferrostep preprocess` makes one",
            input::name(&job.file)
        ));
    }
    let from = from_frame.unwrap_or(0);
    let usual = if input.is_prepared() { gpre::LOOK_AHEAD_BLOCKS } else { LOOK_AHEAD_BLOCKS };
    let look_ahead = look_ahead.unwrap_or(usual);
    let progress = Progress::new();
    if !input.is_prepared() {
        progress.estimate(&job.file, profile, look_ahead);
    }
    if trace.is_none() && vcd.is_none() {
        let session = Session::print(profile, look_ahead, (), replies(&progress));
        return Ok(run(job, input, &session, &progress, from));
    }
    let mut recorder = Recorder::default();
    let mut protected = inputs(&job.file, &job.profile);
    // The waveform must not replace the trace, so the trace's name is protected before the waveform is opened.
    let trace = trace.map(|path| Output::create(path, Accepted::FileOrStream, &protected)).transpose();
    let trace = trace.map_err(|error| error.to_string())?;
    if let Some(trace) = &trace {
        protected.push(Protected { path: trace.target(), what: "the trace" });
    }
    let vcd = vcd.map(|(path, ..)| Output::create(path, Accepted::FileOrStream, &protected)).transpose();
    let vcd = vcd.map_err(|error| error.to_string())?;
    recorder.trace = trace.map(|out| TraceWriter::new(out, &profile)).transpose().map_err(|error| error.to_string())?;
    recorder.vcd =
        vcd.map(|out| VcdWriter::new(out, &profile, window)).transpose().map_err(|error| error.to_string())?;
    let session = Session::print(profile, look_ahead, recorder, replies(&progress));
    let code = run(job, input, &session, &progress, from);
    let recorder = session.into_observer();
    if recorder.waveform_is_empty() {
        tell("note: no motion lies in the waveform's part (--from, --to): it has the levels only");
    }
    // A job that stops leaves complete files up to that place.
    match recorder.finish() {
        Ok(()) => Ok(code),
        outcome => Ok(exit_code(outcome)),
    }
}

fn preprocess(job: &JobArguments, out: &Path, format: Format) -> Result<ExitCode, String> {
    let (profile, mut input) = open(job)?;
    let name = input::name(&job.file);
    if input.is_prepared() {
        return Err(format!("{name}: this is a prepared job already, and preprocess takes G-code"));
    }
    let encoding = match format {
        Format::Compact => Encoding::Compact,
        Format::Wide => Encoding::Wide,
    };
    // The header is written last, at the beginning of the file, which a pipe cannot do.
    let part =
        Output::create(out, Accepted::File, &inputs(&job.file, &job.profile)).map_err(|error| error.to_string())?;
    let mut part = BufWriter::new(part);
    let progress = Progress::new();
    let replies = replies(&progress);
    let started = Instant::now();
    let place = input.place();
    let picture = gpre::take_thumbnail(&mut input).map_err(|error| format!("{name}: cannot be read: {error}"))?;
    let target = gpre::Target { out: &mut part, encoding };
    let prepared = gpre::prepare(&mut input, picture, profile, replies, target, |done, figures| {
        progress.show(place.share(), done, || *figures);
    });
    progress.end();
    let prepared = match prepared {
        Ok(prepared) => prepared,
        Err(PrepareError::Write(error)) => return Err(OutputError::new(out, error).to_string()),
        Err(error @ (PrepareError::Acceleration(_) | PrepareError::FilamentOnTheWay)) => return Err(error.to_string()),
        Err(error @ (PrepareError::Job(_) | PrepareError::Command(..))) => {
            tell(format_args!("error: {name}: {error}"));
            return Ok(ExitCode::from(1));
        }
    };
    let part = part.into_inner().map_err(|error| OutputError::new(out, error.into_error()).to_string())?;
    part.keep().map_err(|error| error.to_string())?;
    let wall_s = started.elapsed().as_secs_f64();
    let summary = PreparedSummary::new(&job.file, out, profile.name, &prepared, wall_s);
    let code = result(job.json.then_some(&summary), || format!("{summary}\n"));
    Ok(if job.strict && code == ExitCode::SUCCESS { strict(job, &summary.remarks) } else { code })
}

fn inspect(file: &Path, shown: Shown) -> Result<ExitCode, String> {
    let name = input::name(file);
    let input = Input::open(file).map_err(|error| format!("{name}: {error}"))?;
    if let (Some(description), Shown::Frames) = (input.description(), shown) {
        return Ok(exit_code(terminal::write_result(&description.to_string())));
    }
    if !input.is_prepared() {
        return Err(format!(
            "{name}: this is G-code; inspect takes a prepared job, which `ferrostep preprocess` makes, and of binary G-code \
             shows what its slicer says"
        ));
    }
    let mut out = BufWriter::new(std::io::stdout().lock());
    let outcome = gpre::inspect(input, shown, &mut out);
    let code = match outcome {
        Ok(()) => exit_code(terminal::result_written(out.flush())),
        Err(InspectError::Write(error)) => exit_code(terminal::result_written(Err(error))),
        Err(InspectError::Job(error)) => {
            let _ = out.flush();
            exit_code(Err(format!("{name}: {error}")))
        }
    };
    Ok(code)
}

/// Shows the machine's messages: errors always, notices up to a maximum.
fn replies(progress: &Progress) -> JobReplies<'_> {
    let shown = Cell::new(0);
    JobReplies::new(move |text: &str| {
        shown.set(shown.get() + 1);
        match shown.get() {
            // An error tells why the machine stopped, and is shown after any number of notices.
            _ if text.starts_with("Error:") => progress.say(text),
            ..=MAX_NOTICES => progress.say(text),
            count if count == MAX_NOTICES + 1 => progress.say("(further notices of the machine are left out)"),
            _ => {}
        }
    })
}

/// With `--strict`: exit status 1 if there are remarks that say more than that corners follow the profile.
fn strict(job: &JobArguments, remarks: &[Remark]) -> ExitCode {
    let remarks: Vec<&Remark> = remarks.iter().filter(|remark| remark.kind != RemarkKind::Corner).collect();
    match remarks[..] {
        [] => ExitCode::SUCCESS,
        [first, ..] => {
            let (name, count) = (printable::name(&job.file), remarks.len());
            exit_code(Err(format!("{name}: {count} remarks, and none expected (--strict): {first}")))
        }
    }
}

/// Runs the job, a prepared one from a frame on, and prints its summary.
fn run<D: Desk>(
    job: &JobArguments,
    mut input: Input,
    session: &Session<D, JobReplies<'_>>,
    progress: &Progress,
    from: u32,
) -> ExitCode {
    let started = Instant::now();
    let profile = session.profile();
    let mut printer = session.printer();
    let mut done = JobProgress::default();
    let place = input.place();
    let look = |job: &JobProgress| progress.show(place.share(), job, || session.figures());
    let mut watch = Watch::new(profile, session.replies().remarks());
    let outcome = if input.is_prepared() {
        // It is planned already, and most of it fits into the look-ahead: only its execution takes time.
        let job = gpre::play_from(from, &mut input, profile, &mut printer, &mut done, look);
        session.run_with(job, |session| progress.pass_time(|| session.figures()))
    } else {
        let outcome = session.run(job::run_watched(&mut input, &mut printer, &mut done, &mut watch, look));
        watch.end_of_text(outcome.is_ok());
        outcome
    };
    watch.end(&session.heating(), outcome.is_ok());
    let wall_s = started.elapsed().as_secs_f64();
    progress.end();

    let figures = session.figures();
    let tally = printer.tally();
    let summary = Summary {
        file: job.file.to_string_lossy().into_owned(),
        profile: profile.name.to_owned(),
        lines: done.lines,
        moves: tally.moves,
        unknown_commands: session.replies().unknown_commands(),
        clamped_moves: tally.clamped_moves,
        print_time_s: figures.print_time_s,
        motion_time_s: figures.motion_time_s,
        filament_mm: tally.filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64,
        position_mm: printer.logical_10nm().map(|length| length as f64 / UNITS_PER_MM as f64).into(),
        motors: D::MAKES_STEPS.then(|| Motors::from(&figures)),
        wall_s,
        realtime_factor: figures.motion_time_s / wall_s.max(1e-9),
        layers: done.layers,
        slicer: input.description().map(|description| description.figures.clone()),
        slicer_time_s: done.slicer_time_s.or(input.description().and_then(|said| Some(said.figures.time_s?.into()))),
        remarks: Some(session.replies().remarks().to_vec()),
        stopped: outcome.as_ref().err().map(Stop::from),
    };
    let code = result(job.json.then_some(&summary), || format!("{summary}\n"));
    match outcome {
        Ok(()) if job.strict && code == ExitCode::SUCCESS => {
            strict(job, summary.remarks.as_deref().unwrap_or_default())
        }
        Ok(()) => code,
        Err(error) => exit_code(Err(format!("{}: {error}", input::name(&job.file)))),
    }
}
