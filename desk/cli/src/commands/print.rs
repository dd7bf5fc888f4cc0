//! `ferrostep print`.

mod waveform;

use std::path::Path;
use std::process::ExitCode;

use ferrostep_session::Session;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::gpre;
use ferrostep_session::input;
use ferrostep_session::output::{Accepted, Output, Protected};
use ferrostep_session::record::{Recorder, TraceWriter, VcdWriter, Window};

use crate::arguments::{Edge, JobArguments};
use crate::job::{self, open, replies};
use crate::machine;
use crate::outcome::exit_code;
use crate::progress::Progress;
use crate::protected::inputs;
use crate::terminal::tell;

/// Executes the job on the virtual board, step by step, and reports the result.
pub fn run(
    arguments: &JobArguments,
    look_ahead: Option<usize>,
    from_frame: Option<u32>,
    trace: Option<&Path>,
    vcd: Option<(&Path, Option<Edge>, Option<Edge>)>,
) -> Result<ExitCode, String> {
    let window =
        vcd.map(|(_, from, to)| waveform::window(&arguments.file, from, to)).transpose()?.unwrap_or(Window::ALL);
    let (profile, input) = open(arguments, arguments.profile.as_deref())?;
    let named = arguments.file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gpre"));
    match (named, input.is_prepared()) {
        (true, false) => tell(format_args!(
            "note: {}: the name says prepared job, the content is G-code: printing it as G-code",
            input::name(&arguments.file)
        )),
        (false, true) => tell(format_args!(
            "note: {}: the content is a prepared job: printing it as that",
            input::name(&arguments.file)
        )),
        _ => {}
    }
    if from_frame.is_some() && !input.is_prepared() {
        return Err(format!(
            "{}: this is G-code, and --from-frame needs a prepared job: `ferrostep preprocess` makes one",
            input::name(&arguments.file)
        ));
    }
    let from = from_frame.unwrap_or(0);
    let usual = if input.is_prepared() { gpre::LOOK_AHEAD_BLOCKS } else { LOOK_AHEAD_BLOCKS };
    let look_ahead = look_ahead.unwrap_or(usual);
    let progress = Progress::new();
    if !input.is_prepared() {
        progress.estimate(&arguments.file, profile, look_ahead);
    }
    if trace.is_none() && vcd.is_none() {
        let session = Session::print(profile, look_ahead, (), replies(&progress));
        return Ok(job::run(arguments, input, &session, &progress, from, |_| Ok(None)));
    }
    let mut recorder = Recorder::default();
    let mut protected = inputs(&arguments.file, machine::name_or_path(arguments.profile.as_deref()));
    // The waveform must not replace the trace, so the trace's name is protected before the
    // waveform is opened.
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
    let code = job::run(arguments, input, &session, &progress, from, |_| Ok(None));
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
