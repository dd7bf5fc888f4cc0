//! `ferrostep blackbox`.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use ferrostep_black_box::Contents;
use ferrostep_host::black_box_lines;
use ferrostep_host::printer_line::{Address, PrinterLine};
use ferrostep_host::send::{FetchError, Patience, fetch_black_box};
use ferrostep_planner::StepObserver;
use ferrostep_printer::Profile;
use ferrostep_session::black_box::{BlackBoxReport, Image, replay_made};
use ferrostep_session::input;
use ferrostep_session::output::{Accepted, Output, Protected};
use ferrostep_session::record::{Recorder, TraceWriter};

use crate::arguments::BlackBoxArguments;
use crate::outcome::{exit_code, result};

/// First bytes of a saved black box.
const MAGIC: &[u8] = b"FBX1";

/// Largest file that is read, bytes: a terminal's log of some days.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// Fetches a printer's black box, or reads a saved one, and reports its contents.
///
/// # Errors
/// The port cannot be opened, the file not be read, or an output not be begun.
pub fn run(arguments: &BlackBoxArguments) -> Result<ExitCode, String> {
    let path = Path::new(&arguments.source);
    let is_file = path.is_file();
    let saved = is_file.then(|| read(path)).transpose()?;
    let named =
        arguments.profile.as_deref().map(ferrostep_profiles::load).transpose().map_err(|error| error.to_string())?;
    // The outputs are opened before the printer is asked.
    let mut protected = Vec::new();
    if is_file {
        protected.push(Protected { path, what: "the black box to be read" });
    }
    let create = |path: &Path, accepted, protected: &[Protected<'_>]| {
        Output::create(path, accepted, protected).map_err(|error| error.to_string())
    };
    let out = arguments.out.as_deref().map(|path| create(path, Accepted::File, &protected)).transpose()?;
    if let Some(out) = &out {
        protected.push(Protected { path: out.target(), what: "the saved black box" });
    }
    let trace = arguments.trace.as_deref().map(|path| create(path, Accepted::FileOrStream, &protected)).transpose()?;
    let bytes = match saved {
        Some(bytes) => bytes,
        None => match fetch(arguments)? {
            Ok(bytes) => bytes,
            Err(error) => return Ok(exit_code(Err(error))),
        },
    };
    if let Some(mut out) = out {
        let written = out.write_all(&bytes).map_err(|error| out.failed(error));
        if let Err(error) = written.and_then(|()| out.keep()) {
            return Ok(exit_code(Err(error)));
        }
    }
    let contents = match Contents::read(&bytes) {
        Ok(contents) => contents,
        Err(error) => return Ok(exit_code(Err(format!("{}: {error}", input::name(path))))),
    };
    // The profile that the board names, if this program has it.
    let profile = named.or_else(|| {
        let name = contents.identity.profile;
        ferrostep_profiles::builtin_text(name).and_then(|_| ferrostep_profiles::load(name).ok())
    });
    if let Some(trace) = trace
        && let Err(error) = write_trace(trace, &contents, profile.as_ref())
    {
        return Ok(exit_code(Err(error)));
    }
    let mut report = BlackBoxReport::new(&contents, profile.as_ref());
    if let Some(image) = &arguments.image {
        match Image::open(image, &contents.identity) {
            Ok(image) => report.locate(&image),
            Err(error) => return Ok(exit_code(Err(error))),
        }
    }
    Ok(result(arguments.json.then_some(&report), || report.to_string()))
}

/// A saved black box: its bytes, or a log with its lines.
fn read(path: &Path) -> Result<Vec<u8>, String> {
    let name = input::name(path);
    let size = path.metadata().map_err(|error| format!("{name}: {error}"))?.len();
    if size > MAX_FILE_BYTES {
        return Err(format!(
            "{name}: {size} bytes, expected at most {MAX_FILE_BYTES}: cut the part with the answer to M791 out"
        ));
    }
    let bytes = std::fs::read(path).map_err(|error| format!("{name}: {error}"))?;
    if bytes.starts_with(MAGIC) {
        return Ok(bytes);
    }
    black_box_lines::from_text(&String::from_utf8_lossy(&bytes)).map_err(|error| format!("{name}: {error}"))
}

fn fetch(arguments: &BlackBoxArguments) -> Result<Result<Vec<u8>, FetchError>, String> {
    let address: Address = arguments.source.parse()?;
    let mut line = PrinterLine::open(&address, arguments.baud).map_err(|error| format!("{address}: {error}"))?;
    Ok(fetch_black_box(&mut line, Patience::DEFAULT, |_| {}))
}

fn write_trace(out: Output, contents: &Contents<'_>, profile: Option<&Profile>) -> Result<(), String> {
    let profile = profile.ok_or_else(|| {
        let name = contents.identity.profile;
        format!("--trace needs the machine's profile, and {name:?} is not built in: add --profile with its TOML file")
    })?;
    let trace = TraceWriter::new(out, profile).map_err(|error| error.to_string())?;
    let mut recorder = Recorder { trace: Some(trace), vcd: None };
    replay_made(contents, |step| recorder.stepped(step.tick, step.axes, step.backwards));
    recorder.finish().map_err(|error| error.to_string())
}
