//! Corrects the times in a file: reads it, and replaces it when its copy is complete.

use std::fmt;
use std::fs::{File, Metadata};
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::time::SystemTime;

use ferrostep_host::printable::{is_standard_input, name};
use ferrostep_session::desk::{Desk, Figures};
use ferrostep_session::duration::hms;
use ferrostep_session::input::{self, Input};
use ferrostep_session::job::JobProgress;
use ferrostep_session::output::{Accepted, Output, Protected};
use ferrostep_session::{JobReplies, Session};
use serde::Serialize;

use crate::binary::rewrite_binary;
use crate::print_times::PrintTimes;
use crate::rewrite::{Additions, Changes, RewriteError, rewrite};

/// A file to correct.
#[derive(Clone, Copy, Debug)]
pub struct Options<'a> {
    /// The file.
    pub file: &'a Path,
    /// The file to write, if not this one.
    pub out: Option<&'a Path>,
    /// Lines that it gets if it has none.
    pub additions: Additions<'a>,
    /// Files that must not be replaced.
    pub protected: &'a [Protected<'a>],
}

/// Reason for which a file stays as it is.
#[derive(Debug)]
pub enum Failure {
    /// Nothing was begun: the file is not one that can be corrected, or the place of the new one
    /// not writable.
    Start(String),
    /// The job stops at a line, has no time, or its copy could not be written.
    Job(String),
}

/// The outcome, and its `--json`.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The file, as given.
    pub file: String,
    /// The file that was written.
    pub out: String,
    /// Name of the machine.
    pub profile: String,
    /// Virtual time from the first line to the last step, s.
    pub print_time_s: f64,
    /// The slicer's time, from a comment, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slicer_time_s: Option<f64>,
    /// Comments and entries of metadata that hold a time.
    pub comments: u64,
    /// Lines of the slicer with M73.
    pub progress_lines: u64,
    /// Lines with M73 that were added.
    pub added_lines: u64,
    /// Words for the time to a pause that stay as they are, since no pause comes after them.
    pub kept_pause_words: u64,
    /// Remarks on the job's lines, which `estimate` lists.
    pub remarks: usize,
    /// True if the text has changed.
    pub changed: bool,
}

impl fmt::Display for Report {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: {}", name(Path::new(&self.out)), hms(self.print_time_s))?;
        if let Some(slicer_time_s) = self.slicer_time_s.filter(|_| self.changed) {
            write!(out, " (it said {})", hms(slicer_time_s))?;
        }
        let lines = self.progress_lines + self.added_lines;
        let (comments, m73) = (plural(self.comments, "comment"), plural(lines, "line"));
        let verb = if self.changed { "written into" } else { "already in" };
        write!(out, ", {verb} {comments} and {m73} of M73")?;
        if self.kept_pause_words > 0 {
            write!(out, "; {} of M73 C and D kept, with no pause after them", plural(self.kept_pause_words, "word"))?;
        }
        if self.remarks > 0 {
            write!(out, "; {} (`ferrostep estimate` lists them)", plural(self.remarks as u64, "remark"))?;
        }
        Ok(())
    }
}

fn plural(count: u64, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// Writes the times of a print into its file, or into a copy. Another file of that name is replaced
/// when the copy is complete; one that would not change is not written. `look` is called after each
/// portion that was executed, with the share of the file so far. `session` is a machine that only
/// plans and has just been switched on.
///
/// # Errors
/// The file cannot be corrected; it is unchanged then.
pub fn post_process<D: Desk>(
    options: &Options<'_>,
    session: &Session<D, JobReplies<'_>>,
    mut look: impl FnMut(Option<f64>, &JobProgress, &dyn Fn() -> Figures),
) -> Result<Report, Failure> {
    let Options { file, out, additions, protected } = *options;
    let named = |reason: &dyn fmt::Display| format!("{}: {reason}", input::name(file));
    let start = |reason: &dyn fmt::Display| Failure::Start(named(reason));
    let job = |reason: &dyn fmt::Display| Failure::Job(named(reason));
    let mut input = open(file).map_err(|reason| start(&reason))?;
    let target = out.unwrap_or(file);
    let accepted = if out.is_some() { Accepted::FileOrStream } else { Accepted::File };
    let part = Output::create(target, accepted, protected).map_err(|error| Failure::Start(error.to_string()))?;

    let before = state(file).map_err(|error| start(&error))?;
    let place = input.place();
    let profile_name = session.profile().name.to_owned();
    let times = PrintTimes::of(&mut input, session, |done, figures| look(place.share(), done, figures))
        .map_err(|error| job(&error))?;
    if times.total_s() <= 0.0 {
        return Err(job(&"the print has no motion, and so no time: is it the file that was meant?"));
    }
    let text = File::open(file).map_err(|error| job(&error))?;
    let mut copy = BufWriter::new(part);
    let rewritten = if input.description().is_some() {
        let gcode = Input::open(file).map_err(|error| job(&error))?;
        rewrite_binary(text, gcode, &mut copy, &times, additions)
    } else {
        rewrite(text, &mut copy, &times, additions)
    };
    let rewritten = rewritten.and_then(|changes| copy.flush().map(|()| changes).map_err(RewriteError::Write));
    let changes = match rewritten {
        Ok(changes) => changes,
        Err(RewriteError::Write(error)) => return Err(Failure::Job(copy.get_ref().failed(error).to_string())),
        Err(error) => return Err(job(&error)),
    };
    if state(file).map_err(|error| job(&error))? != before {
        return Err(job(&"the file was changed by another program meanwhile: run the command again"));
    }
    if changes.differs || out.is_some() {
        Output::keep_buffered(copy).map_err(|error| Failure::Job(error.to_string()))?;
    }
    let slicer_time_s = times.slicer_time_s().or_else(|| Some(input.description()?.figures.time_s?.into()));
    Ok(report(options, profile_name, slicer_time_s, &times, changes))
}

fn report(
    options: &Options<'_>,
    profile: String,
    slicer_time_s: Option<f64>,
    times: &PrintTimes,
    changes: Changes,
) -> Report {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    Report {
        file: text(options.file),
        out: text(options.out.unwrap_or(options.file)),
        profile,
        print_time_s: times.total_s(),
        slicer_time_s,
        comments: changes.comments,
        progress_lines: changes.progress_lines,
        added_lines: changes.added_lines,
        kept_pause_words: changes.kept_pause_words,
        remarks: times.remarks(),
        changed: changes.differs,
    }
}

/// Opens a file whose text can be replaced.
fn open(file: &Path) -> Result<Input, String> {
    if is_standard_input(file) {
        return Err("it can be read once only, and its times are known after that: give the name of a file".to_owned());
    }
    let metadata = file.metadata().map_err(|error| format!("cannot be read: {error}"))?;
    if !metadata.is_file() && !metadata.is_dir() {
        return Err("this is a pipe or a device, which can be read once only: give the name of a file".to_owned());
    }
    if metadata.is_file()
        && let Some(packing) = input::packing(file).map_err(|error| format!("cannot be read: {error}"))?
    {
        return Err(format!("this is {packing}: unpack it, and give the G-code that is in it"));
    }
    let input = Input::open(file).map_err(|error| error.to_string())?;
    if input.is_prepared() {
        return Err("this is a prepared job, which holds no text: give the G-code that it was made of".to_owned());
    }
    Ok(input)
}

/// Size and time of a file, by which a change shows.
fn state(file: &Path) -> io::Result<(u64, Option<SystemTime>)> {
    file.metadata().map(|metadata: Metadata| (metadata.len(), metadata.modified().ok()))
}
