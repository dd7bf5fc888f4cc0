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
use ferrostep::papers::{Chapter, Paper, choices};
use ferrostep::record::{Observer, Recorder, TraceWriter, VcdWriter};
use ferrostep::report::{Motors, Stop, Summary};
use ferrostep::session::{JobReplies, Session};
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::Profile;
use indicatif::{ProgressBar, ProgressStyle};

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
    /// The tables and figures of the papers that the machine works by, made anew; all papers without a name.
    Papers {
        /// Which paper.
        #[arg(value_enum)]
        paper: Option<PaperName>,
        /// Prints one JSON object.
        #[arg(long)]
        json: bool,
        /// Draws the figures into a folder.
        #[arg(long, value_name = "DIR")]
        svg: Option<PathBuf>,
        /// Instead, prints a file in every way to interpolate and to accelerate, and compares them.
        #[arg(long, value_name = "FILE", conflicts_with_all = ["paper", "svg"])]
        compare: Option<PathBuf>,
        /// The machine to compare on: cartesian, corexy, prusa-mini, or a TOML file.
        #[arg(long, value_name = "NAME|PATH", default_value = "cartesian", requires = "compare")]
        profile: String,
    },
}

/// The papers by their short names.
#[derive(Clone, Copy, clap::ValueEnum)]
enum PaperName {
    /// Step Bresenham and velocity-adaptive extrusion (2024).
    Wu,
    /// Planning on the computer, look-ahead (2019).
    Yu,
    /// CoreXY plane control.
    Corexy,
    /// S-curve acceleration (2017).
    Li,
}

impl From<PaperName> for Paper {
    fn from(name: PaperName) -> Self {
        match name {
            PaperName::Wu => Self::Wu,
            PaperName::Yu => Self::Yu,
            PaperName::Corexy => Self::CoreXy,
            PaperName::Li => Self::Li,
        }
    }
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
    let outcome = match Arguments::parse().command {
        Command::Print { job, look_ahead, trace, vcd } => {
            print(&job, look_ahead as usize, trace.as_deref(), vcd.as_deref())
        }
        Command::Estimate { job } => estimate(&job),
        Command::Papers { compare: Some(file), profile, json, .. } => compare(&file, &profile, json),
        Command::Papers { paper, json, svg, .. } => papers(paper.map(Paper::from), json, svg.as_deref()),
    };
    // What could not start says why and exits like wrong arguments do.
    outcome.unwrap_or_else(|reason| {
        eprintln!("error: {reason}");
        ExitCode::from(2)
    })
}

fn papers(paper: Option<Paper>, json: bool, folder: Option<&Path>) -> Result<ExitCode, String> {
    let papers = paper.map_or_else(|| Paper::ALL.to_vec(), |paper| vec![paper]);
    let chapters: Vec<_> = papers.into_iter().map(Paper::chapter).collect();
    if let Some(folder) = folder {
        for chapter in &chapters {
            for path in chapter.draw(folder).map_err(|error| error.to_string())? {
                eprintln!("{}", path.display());
            }
        }
    }
    let out = if json {
        serde_json::to_string(&serde_json::json!({ "papers": chapters })).map_err(|error| error.to_string())? + "\n"
    } else {
        chapters.iter().map(Chapter::text).collect::<Vec<_>>().join("\n")
    };
    write!(std::io::stdout(), "{out}").map_err(|error| format!("standard output: {error}"))?;
    Ok(ExitCode::SUCCESS)
}

fn compare(file: &Path, profile: &str, json: bool) -> Result<ExitCode, String> {
    let profile = ferrostep_profiles::load(profile).map_err(|error| error.to_string())?;
    let bar = ProgressBar::new(choices::ways().count() as u64)
        .with_style(ProgressStyle::with_template("{bar:40} {pos}/{len} {msg}").map_err(|error| error.to_string())?);
    let table = choices::compare(file, &profile, |interpolation, acceleration| {
        bar.set_message(format!("{}, {}", interpolation.name(), acceleration.name()));
        bar.inc(1);
    });
    bar.finish_and_clear();
    let table = table.map_err(|error| format!("{}: {error}", file.display()))?;
    let out = if json {
        serde_json::to_string(&serde_json::json!({ "choices": table })).map_err(|error| error.to_string())? + "\n"
    } else {
        table.text()
    };
    write!(std::io::stdout(), "{out}").map_err(|error| format!("standard output: {error}"))?;
    Ok(ExitCode::SUCCESS)
}

/// The machine and the open file of a job.
fn open(job: &JobArguments) -> Result<(Profile, Input), String> {
    let profile = ferrostep_profiles::load(&job.profile).map_err(|error| error.to_string())?;
    let input = Input::open(&job.file).map_err(|error| format!("{}: {error}", job.file.display()))?;
    Ok((profile, input))
}

fn estimate(job: &JobArguments) -> Result<ExitCode, String> {
    let (profile, input) = open(job)?;
    run(job, input, profile, Mode::Estimate, LOOK_AHEAD_BLOCKS, ()).map(|(code, ())| code)
}

fn print(job: &JobArguments, look_ahead: usize, trace: Option<&Path>, vcd: Option<&Path>) -> Result<ExitCode, String> {
    let (profile, input) = open(job)?;
    if trace.is_none() && vcd.is_none() {
        return run(job, input, profile, Mode::Print, look_ahead, ()).map(|(code, ())| code);
    }
    let mut recorder = Recorder::default();
    if let Some(path) = trace {
        recorder.trace = Some(TraceWriter::create(writable(path, job)?, &profile).map_err(|e| unwritable(path, e))?);
    }
    if let Some(path) = vcd {
        recorder.vcd = Some(VcdWriter::create(writable(path, job)?, &profile).map_err(|e| unwritable(path, e))?);
    }
    let (code, mut recorder) = run(job, input, profile, Mode::Print, look_ahead, recorder)?;
    match recorder.finish() {
        Ok(()) => Ok(code),
        Err(error) => {
            eprintln!("error: the trace is incomplete: {error}");
            Ok(ExitCode::from(1))
        }
    }
}

fn unwritable(path: &Path, error: impl std::fmt::Display) -> String {
    format!("{}: cannot be written: {error}", path.display())
}

/// A path that may be written: anything but the job itself.
fn writable<'a>(path: &'a Path, job: &JobArguments) -> Result<&'a Path, String> {
    match (path.canonicalize(), job.file.canonicalize()) {
        (Ok(out), Ok(input)) if out == input => Err(unwritable(path, "it is the file to print, expected another name")),
        _ => Ok(path),
    }
}

/// Runs the job and prints its summary; the observer comes back to be finished.
fn run<O: Observer>(
    job: &JobArguments,
    mut input: Input,
    profile: Profile,
    mode: Mode,
    look_ahead: usize,
    observer: O,
) -> Result<(ExitCode, O), String> {
    let name = job.file.display().to_string();
    let progress = Progress::new(input.size_bytes());
    let shown = Cell::new(0);
    let replies = JobReplies::new(|text: &str| {
        shown.set(shown.get() + 1);
        match shown.get() {
            // Why a machine stands still must not drown.
            _ if text.starts_with("Error:") => progress.say(text),
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
