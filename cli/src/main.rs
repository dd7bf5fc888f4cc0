//! The `ferrostep` command.

mod progress;

use std::cell::Cell;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, Subcommand};
use ferrostep::desk::{LOOK_AHEAD_BLOCKS, Mode};
use ferrostep::input::Input;
use ferrostep::job::{self, JobProgress};
use ferrostep::record::{Observer, Recorder, TraceWriter, VcdWriter};
use ferrostep::report::{Motors, Stop, Summary};
use ferrostep::session::{JobReplies, Session};
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::Profile;

use progress::Progress;

/// Most notices of the machine that are shown; a broken file could ask for one a line.
const MOST_NOTICES: u32 = 20;

/// The 3D-printer firmware that rehearses on the desk what it does on the board.
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Prints a file on the virtual board: the whole machine, every step.
    Print {
        #[command(flatten)]
        job: JobArguments,
        /// Blocks in the look-ahead ring.
        #[arg(long, value_name = "N", default_value_t = LOOK_AHEAD_BLOCKS as u32, value_parser = clap::value_parser!(u32).range(2..=1_048_576))]
        look_ahead: u32,
        /// Writes every step event to a file.
        #[arg(long, value_name = "OUT")]
        trace: Option<PathBuf>,
        /// Writes step and direction signals as a waveform.
        #[arg(long, value_name = "OUT")]
        vcd: Option<PathBuf>,
    },
    /// Time and material of a file, without its steps.
    Estimate {
        #[command(flatten)]
        job: JobArguments,
    },
}

#[derive(clap::Args)]
struct JobArguments {
    /// G-code, plain or gzip.
    file: PathBuf,
    /// The machine: cartesian, corexy, prusa-mini, or a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    profile: String,
    /// Prints the result as one JSON object.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    match Arguments::parse().command {
        Command::Print { job, look_ahead, trace, vcd } => {
            print(&job, look_ahead as usize, trace.as_deref(), vcd.as_deref())
        }
        Command::Estimate { job } => with_profile(&job, |profile| {
            run(&job, profile, Mode::Estimate, LOOK_AHEAD_BLOCKS, ()).map(|(code, ())| code)
        }),
    }
}

/// Could not start: says why.
fn refuse(what: impl std::fmt::Display) -> ExitCode {
    eprintln!("error: {what}");
    ExitCode::from(2)
}

fn with_profile(job: &JobArguments, go: impl FnOnce(Profile) -> Result<ExitCode, String>) -> ExitCode {
    match ferrostep_profiles::load(&job.profile) {
        Ok(profile) => go(profile).unwrap_or_else(refuse),
        Err(error) => refuse(error),
    }
}

fn print(job: &JobArguments, look_ahead: usize, trace: Option<&Path>, vcd: Option<&Path>) -> ExitCode {
    with_profile(job, |profile| {
        if trace.is_none() && vcd.is_none() {
            return run(job, profile, Mode::Print, look_ahead, ()).map(|(code, ())| code);
        }
        // The job must be readable before files are made for it.
        Input::open(&job.file).map_err(|error| format!("{}: {error}", job.file.display()))?;
        let cannot = |path: &Path, error| format!("{}: cannot be written: {error}", path.display());
        let mut recorder = Recorder::default();
        if let Some(path) = trace {
            recorder.trace = Some(TraceWriter::create(path, &profile).map_err(|error| cannot(path, error))?);
        }
        if let Some(path) = vcd {
            recorder.vcd = Some(VcdWriter::create(path, &profile).map_err(|error| cannot(path, error))?);
        }
        let (code, mut recorder) = run(job, profile, Mode::Print, look_ahead, recorder)?;
        match recorder.finish() {
            Ok(()) => Ok(code),
            Err(error) => {
                eprintln!("error: the trace is incomplete: {error}");
                Ok(ExitCode::from(1))
            }
        }
    })
}

/// Runs the job and prints its summary; the observer comes back to be finished.
fn run<O: Observer>(
    job: &JobArguments,
    profile: Profile,
    mode: Mode,
    look_ahead: usize,
    observer: O,
) -> Result<(ExitCode, O), String> {
    let name = job.file.display().to_string();
    let mut input = Input::open(&job.file).map_err(|error| format!("{name}: {error}"))?;
    let progress = Progress::new(input.size_bytes());
    let shown = Cell::new(0);
    let replies = JobReplies::new(|text: &str| {
        shown.set(shown.get() + 1);
        match shown.get() {
            ..=MOST_NOTICES => progress.say(text),
            count if count == MOST_NOTICES + 1 => progress.say("(further messages of the machine are not shown)"),
            _ => {}
        }
    });
    let started = Instant::now();
    let session = Session::new(profile, mode, look_ahead, observer, replies);
    let mut printer = session.printer();
    let mut done = JobProgress::default();
    let counter = input.counter();
    let outcome = session.run(job::run(&mut input, &mut printer, &mut done, |job| {
        progress.show(counter.get(), job, &session.desk().borrow().figures(), started.elapsed());
    }));
    let wall_s = started.elapsed().as_secs_f64();
    progress.end();

    let figures = session.desk().borrow().figures();
    let tally = printer.tally();
    let summary = Summary {
        file: name.clone(),
        profile: profile.name.to_owned(),
        lines: done.lines,
        moves: tally.moves,
        unknown_commands: session.replies().unknown_commands(),
        clamped_moves: tally.clamped_moves,
        print_time_s: figures.print_time_s,
        motion_time_s: figures.motion_time_s,
        filament_mm: tally.filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64,
        position_mm: printer.logical_10nm().map(|length| length as f64 / UNITS_PER_MM as f64).into(),
        motors: (mode == Mode::Print).then(|| Motors::from(&figures)),
        wall_s,
        realtime_factor: figures.motion_time_s / wall_s.max(1e-9),
        layers: done.layers,
        stopped: outcome.as_ref().err().map(Stop::from),
    };
    let text = if job.json {
        serde_json::to_string_pretty(&summary).map_err(|error| error.to_string())?
    } else {
        summary.to_string()
    };
    // Who closes the pipe early (`| head`) has read enough.
    let _ = writeln!(std::io::stdout(), "{text}");
    let code = match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {name}: {error}");
            ExitCode::from(1)
        }
    };
    Ok((code, session.into_observer()))
}
