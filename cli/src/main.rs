//! The `ferrostep` command.

mod progress;
#[cfg(unix)]
mod sending;

use std::cell::Cell;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, Subcommand};
use ferrostep::desk::{LOOK_AHEAD_BLOCKS, Mode};
use ferrostep::gpre::{self, InspectError, PrepareError, PreparedSummary, Shown};
use ferrostep::input::Input;
use ferrostep::job::{self, JobProgress};
use ferrostep::papers::{Chapter, Paper, choices};
use ferrostep::record::{Observer, Recorder, TraceWriter, VcdWriter};
use ferrostep::report::{Motors, Stop, Summary};
use ferrostep::session::{JobReplies, Session};
use ferrostep_gpre::Encoding;
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
        /// Blocks in the look-ahead ring; 128 if not given, and 65536 for a prepared job.
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1_048_576))]
        look_ahead: Option<u32>,
        /// Enters a prepared job at a frame, as after a power cut (`inspect --entries` lists those that can be): heats, takes the
        /// nozzle to stand at the frame's height, homes X and Y alone, goes to the frame's start, and prints on.
        #[arg(long, value_name = "N")]
        from_frame: Option<u32>,
        /// Writes every step event to a file.
        #[arg(long, value_name = "OUT")]
        trace: Option<PathBuf>,
        /// Writes step and direction signals as a waveform.
        #[arg(long, value_name = "OUT")]
        vcd: Option<PathBuf>,
    },
    /// Plans a file's speeds here, with all the look-ahead there is, for a board that only executes them.
    Preprocess {
        #[command(flatten)]
        job: JobArguments,
        /// The prepared job.
        #[arg(short, value_name = "OUT.gpre")]
        out: PathBuf,
        /// Its encoding.
        #[arg(long, value_enum, default_value_t = Format::Compact)]
        format: Format,
    },
    /// What is in a prepared job.
    Inspect {
        /// A prepared job.
        file: PathBuf,
        /// Every move and command, not only where the frames begin.
        #[arg(long)]
        items: bool,
        /// The frames at which the job can be entered, instead of where all begin.
        #[arg(long, conflicts_with = "items")]
        entries: bool,
    },
    /// Sends a prepared job to a board, which executes it as it comes.
    #[cfg(unix)]
    Send {
        /// A prepared job, in the compact encoding.
        file: PathBuf,
        /// The board's serial port.
        #[arg(long, value_name = "PATH", default_value = "/dev/ttyACM0")]
        port: PathBuf,
        /// The port's speed; over USB it does not matter.
        #[arg(long, value_name = "BAUD", default_value_t = 115_200)]
        baud: u32,
        /// G-code to send line by line instead, where the board refuses the prepared job.
        #[arg(long, value_name = "FILE")]
        fallback: Option<PathBuf>,
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

/// The encodings of a prepared job.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Format {
    /// About five bytes a move.
    Compact,
    /// The paper's packets of 84 bytes.
    Wide,
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
    /// G-code (or, to print, a prepared job), plain or gzip.
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
        Command::Print { job, look_ahead, from_frame, trace, vcd } => {
            print(&job, look_ahead.map(|blocks| blocks as usize), from_frame, trace.as_deref(), vcd.as_deref())
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
        #[cfg(unix)]
        Command::Send { file, port, baud, fallback } => sending::run(&file, &port, baud, fallback.as_deref()),
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
    if input.is_prepared() {
        return Err(format!("{}: it is a prepared job, expected G-code (inspect tells its time)", job.file.display()));
    }
    run(job, input, profile, Mode::Estimate, (LOOK_AHEAD_BLOCKS, 0), ()).map(|(code, ())| code)
}

fn print(
    job: &JobArguments,
    look_ahead: Option<usize>,
    from_frame: Option<u32>,
    trace: Option<&Path>,
    vcd: Option<&Path>,
) -> Result<ExitCode, String> {
    let (profile, input) = open(job)?;
    let named = job.file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gpre"));
    match (named, input.is_prepared()) {
        (true, false) => {
            eprintln!("note: {}: named a prepared job, but it is G-code: printed as that", job.file.display())
        }
        (false, true) => {
            eprintln!("note: {}: named G-code, but it is a prepared job: printed as that", job.file.display())
        }
        _ => {}
    }
    if from_frame.is_some() && !input.is_prepared() {
        return Err(format!("{}: it is G-code, expected a prepared job to enter at a frame", job.file.display()));
    }
    let from = from_frame.unwrap_or(0);
    let usual = if input.is_prepared() { gpre::LOOK_AHEAD_BLOCKS } else { LOOK_AHEAD_BLOCKS };
    let look_ahead = look_ahead.unwrap_or(usual);
    if trace.is_none() && vcd.is_none() {
        return run(job, input, profile, Mode::Print, (look_ahead, from), ()).map(|(code, ())| code);
    }
    let mut recorder = Recorder::default();
    if let Some(path) = trace {
        recorder.trace = Some(TraceWriter::create(writable(path, job)?, &profile).map_err(|e| unwritable(path, e))?);
    }
    if let Some(path) = vcd {
        recorder.vcd = Some(VcdWriter::create(writable(path, job)?, &profile).map_err(|e| unwritable(path, e))?);
    }
    let (code, mut recorder) = run(job, input, profile, Mode::Print, (look_ahead, from), recorder)?;
    match recorder.finish() {
        Ok(()) => Ok(code),
        Err(error) => {
            eprintln!("error: the trace is incomplete: {error}");
            Ok(ExitCode::from(1))
        }
    }
}

fn preprocess(job: &JobArguments, out: &Path, format: Format) -> Result<ExitCode, String> {
    let (profile, mut input) = open(job)?;
    let name = job.file.display();
    if input.is_prepared() {
        return Err(format!("{name}: it is a prepared job already, expected G-code"));
    }
    let encoding = match format {
        Format::Compact => Encoding::Compact,
        Format::Wide => Encoding::Wide,
    };
    // What is not complete has another name: no board shall find half a job.
    let mut part = writable(out, job)?.as_os_str().to_owned();
    part.push(".part");
    let part = PathBuf::from(part);
    let file = File::create(&part).map_err(|error| unwritable(&part, error))?;
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
    let counter = input.counter();
    let picture = Input::open(&job.file).ok().and_then(gpre::find_thumbnail);
    let target = gpre::Target { out: BufWriter::new(file), encoding };
    let prepared = gpre::prepare(&mut input, picture, profile, replies, target, |done, figures| {
        progress.show(counter.get(), done, figures, started.elapsed());
    });
    progress.end();
    let prepared = match prepared {
        Ok(prepared) => prepared,
        Err(error) => {
            // It may be that there is nothing to be removed.
            let _ = std::fs::remove_file(&part);
            return match error {
                PrepareError::Acceleration(_) => Err(error.to_string()),
                PrepareError::Write(error) => Err(unwritable(out, error)),
                PrepareError::Job(_) | PrepareError::Command(..) => {
                    eprintln!("error: {name}: {error}");
                    Ok(ExitCode::from(1))
                }
            };
        }
    };
    std::fs::rename(&part, out).map_err(|error| unwritable(out, error))?;
    let wall_s = started.elapsed().as_secs_f64();
    let summary = PreparedSummary::new(&job.file, out, profile.name, &prepared, wall_s);
    let text = if job.json {
        serde_json::to_string_pretty(&summary).map_err(|error| error.to_string())?
    } else {
        summary.to_string()
    };
    let _ = writeln!(std::io::stdout(), "{text}");
    Ok(ExitCode::SUCCESS)
}

fn inspect(file: &Path, shown: Shown) -> Result<ExitCode, String> {
    let name = file.display();
    let input = Input::open(file).map_err(|error| format!("{name}: {error}"))?;
    if !input.is_prepared() {
        return Err(format!("{name}: it is G-code, expected a prepared job"));
    }
    let mut out = BufWriter::new(std::io::stdout().lock());
    match gpre::inspect(input, shown, &mut out) {
        // Who closes the pipe early (`| head`) has read enough.
        Ok(()) | Err(InspectError::Write(_)) => Ok(ExitCode::SUCCESS),
        Err(InspectError::Job(error)) => {
            let _ = out.flush();
            eprintln!("error: {name}: {error}");
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

/// Runs the job, a prepared one from a frame on, and prints its summary; the observer comes back to be finished.
fn run<O: Observer>(
    job: &JobArguments,
    mut input: Input,
    profile: Profile,
    mode: Mode,
    (look_ahead, from): (usize, u32),
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
    let look = |job: &JobProgress| {
        progress.show(counter.get(), job, &session.desk().borrow().figures(), started.elapsed());
    };
    let outcome = if input.is_prepared() {
        session.run(gpre::play_from(from, &mut input, &profile, &mut printer, &mut done, look))
    } else {
        session.run(job::run(&mut input, &mut printer, &mut done, look))
    };
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
