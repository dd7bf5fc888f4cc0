//! Runs a G-code file: its lines, in order.

use std::fmt;
use std::io::{self, Read};

use ferrostep_gcode::{Checksum, Line, LineError, LineReader};
use ferrostep_printer::{CommandError, Ports, Printer};
use ferrostep_show::Mark;

use crate::ahead::{Ahead, PORTION_BYTES};
use crate::comments::Comments;
use crate::macros::{FileMacros, Macros};
use crate::remarks::RemarkKind;
use crate::unread::Unread;

/// Reason for which a job stopped before its end.
#[derive(Debug)]
pub enum JobError {
    /// A line could not be executed.
    Line {
        /// Number of the line in the file, from 1.
        line: u32,
        /// Text of the line, as far as it could be read.
        text: String,
        /// The error, and how to mend it.
        message: String,
    },
    /// Reading the file failed.
    Read {
        /// The last line before.
        line: u32,
        /// The reader's error.
        error: io::Error,
    },
    /// A frame of a prepared job could not be executed.
    Prepared {
        /// Number of the frame, where there is one.
        frame: Option<u32>,
        /// Source line of the item that could not be executed, where it is one.
        line: Option<u32>,
        /// Byte of the file at which the frame, or the fault, begins.
        offset: u64,
        /// The error, and how to mend it.
        message: String,
    },
    /// The job cannot be entered at this frame.
    Entry {
        /// The frame.
        frame: u32,
        /// The error, and how to mend it.
        message: String,
    },
    /// All lines were executed, but their motion was stopped before its end.
    Stopped(CommandError),
}

impl fmt::Display for JobError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // A line that cannot be read has no text to show.
            Self::Line { line, text, message } if text.is_empty() => write!(out, "line {line}: {message}"),
            Self::Line { line, text, message } => write!(out, "line {line}: {text:?}: {message}"),
            Self::Read { line, error } => write!(out, "after line {line}: the file cannot be read: {error}"),
            Self::Prepared { frame, line, offset, message } => {
                if let Some(frame) = frame {
                    write!(out, "frame {frame} ")?;
                }
                write!(out, "at byte {offset}")?;
                if let Some(line) = line {
                    write!(out, ", line {line}")?;
                }
                write!(out, ": {message}")
            }
            Self::Entry { frame, message } => write!(out, "frame {frame}: {message}"),
            Self::Stopped(error) => write!(out, "at the end: {error}"),
        }
    }
}

impl std::error::Error for JobError {}

/// Progress of a job.
#[derive(Clone, Copy, Debug, Default)]
pub struct JobProgress {
    /// Lines read so far.
    pub lines: u32,
    /// Layers begun, by the slicer's comments.
    pub layers: u32,
    /// Time of the print by the slicer's comment, s.
    pub slicer_time_s: Option<f64>,
    /// Motion of all of the job, s, where its file says it: a prepared job that is executed
    /// from its beginning.
    pub motion_time_s: Option<f64>,
    /// The lines alone do not say where the nozzle goes, since the desk has stood in for macros or
    /// commands of state.
    pub stands_in: bool,
}

/// Observes the lines of a job.
pub trait Onlooker<P: Ports> {
    /// Called before a line is executed.
    fn begins(&mut self, printer: &Printer<'_, P>, line: u32, text: &str);
    /// Called after the line was executed without an error.
    fn ended(&mut self, printer: &Printer<'_, P>);
    /// Called with a slicer's mark and the line of its comment, before that line
    /// and those after it.
    fn marked(&mut self, _line: u32, _mark: &Mark) {}
    /// Called with a remark on a line that the desk replaces.
    fn remarked(&mut self, _kind: RemarkKind, _line: u32, _message: &str) {}
    /// Called with the lines after the one that stops the job.
    fn stopped(&mut self, _unread: Unread) {}
}

/// No observer.
impl<P: Ports> Onlooker<P> for () {
    fn begins(&mut self, _: &Printer<'_, P>, _: u32, _: &str) {}
    fn ended(&mut self, _: &Printer<'_, P>) {}
}

/// An observer, or none.
impl<P: Ports, O: Onlooker<P>> Onlooker<P> for Option<O> {
    fn begins(&mut self, printer: &Printer<'_, P>, line: u32, text: &str) {
        if let Some(onlooker) = self {
            onlooker.begins(printer, line, text);
        }
    }

    fn ended(&mut self, printer: &Printer<'_, P>) {
        if let Some(onlooker) = self {
            onlooker.ended(printer);
        }
    }

    fn marked(&mut self, line: u32, mark: &Mark) {
        if let Some(onlooker) = self {
            onlooker.marked(line, mark);
        }
    }

    fn remarked(&mut self, kind: RemarkKind, line: u32, message: &str) {
        if let Some(onlooker) = self {
            onlooker.remarked(kind, line, message);
        }
    }

    fn stopped(&mut self, unread: Unread) {
        if let Some(onlooker) = self {
            onlooker.stopped(unread);
        }
    }
}

/// Two observers, one after the other; lines left unread are the second's.
impl<P: Ports, A: Onlooker<P>, B: Onlooker<P>> Onlooker<P> for (&mut A, &mut B) {
    fn begins(&mut self, printer: &Printer<'_, P>, line: u32, text: &str) {
        self.0.begins(printer, line, text);
        self.1.begins(printer, line, text);
    }

    fn ended(&mut self, printer: &Printer<'_, P>) {
        self.0.ended(printer);
        self.1.ended(printer);
    }

    fn marked(&mut self, line: u32, mark: &Mark) {
        self.0.marked(line, mark);
        self.1.marked(line, mark);
    }

    fn remarked(&mut self, kind: RemarkKind, line: u32, message: &str) {
        self.0.remarked(kind, line, message);
        self.1.remarked(kind, line, message);
    }

    fn stopped(&mut self, unread: Unread) {
        self.1.stopped(unread);
    }
}

/// Executes all lines of `input` and waits for the end of their motion.
///
/// A line that cannot be executed ends the job: the moves before it are finished, and the line has
/// no effect. `look` is called after each portion of the file.
pub async fn run<P: Ports>(
    input: &mut impl Read,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    look: impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    run_watched(input, printer, progress, Macros::chosen(), &mut (), look).await
}

/// Runs a job as [`run`] does, with an observer of each line, and with macros as said.
pub async fn run_watched<P: Ports>(
    input: &mut impl Read,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    macros: Macros,
    onlooker: &mut impl Onlooker<P>,
    mut look: impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    let outcome = lines(&mut Ahead::new(input), printer, progress, FileMacros::new(macros), onlooker, &mut look).await;
    let finished = printer.finish().await;
    outcome?;
    finished.map_err(JobError::Stopped)
}

async fn lines<P: Ports>(
    input: &mut Ahead<'_>,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    mut macros: FileMacros,
    onlooker: &mut impl Onlooker<P>,
    look: &mut impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    let mut reader = LineReader::new();
    let mut comments = Comments::default();
    let mut buffer = Vec::with_capacity(PORTION_BYTES);
    loop {
        input.next(&mut buffer).map_err(|error| JobError::Read { line: progress.lines, error })?;
        if buffer.is_empty() {
            break;
        }
        let mut portion = &buffer[..];
        comments.read(portion, |line, mark| onlooker.marked(line, mark));
        macros.look(portion);
        (progress.layers, progress.slicer_time_s) = (comments.layers, comments.slicer_time_s);
        while !portion.is_empty() {
            let (used, line) = reader.feed(portion);
            portion = &portion[used..];
            if let Some(line) = line {
                let outcome = execute(printer, line, progress, (&mut macros, input), onlooker).await;
                if outcome.is_err() {
                    let unread = [portion, input.waiting()].concat();
                    onlooker.stopped(Unread::new(reader, unread));
                    return outcome;
                }
            }
        }
        progress.lines = reader.lines_ended();
        look(progress);
    }
    comments.end();
    (progress.layers, progress.slicer_time_s) = (comments.layers, comments.slicer_time_s);
    if let Some(line) = reader.finish() {
        execute(printer, line, progress, (&mut macros, input), onlooker).await?;
    }
    progress.lines = reader.lines_ended();
    let ended = macros.end(printer).await;
    ended.map_err(|message| JobError::Line { line: progress.lines, text: String::new(), message })
}

/// Executes one line. A file needs no line numbers, but a checksum, if present, must be right.
async fn execute<P: Ports>(
    printer: &mut Printer<'_, P>,
    line: Result<Line<'_>, LineError>,
    progress: &mut JobProgress,
    (macros, ahead): (&mut FileMacros, &mut Ahead<'_>),
    onlooker: &mut impl Onlooker<P>,
) -> Result<(), JobError> {
    let stop = |line, text: &str, message| Err(JobError::Line { line, text: text.to_owned(), message });
    let line = match line {
        Ok(line) => line,
        Err(error) => {
            progress.lines = error.line_number();
            return stop(error.line_number(), "", error.to_string());
        }
    };
    match line.checksum {
        Checksum::Absent | Checksum::Right => {}
        Checksum::Wrong { expected, computed } => {
            progress.lines = line.line_number;
            let message = format!("checksum mismatch: the line says {expected}, expected {computed}");
            return stop(line.line_number, line.text, message);
        }
        Checksum::Malformed => {
            progress.lines = line.line_number;
            let message = "malformed checksum, expected a number from 0 to 255 after the '*'".to_owned();
            return stop(line.line_number, line.text, message);
        }
    }
    onlooker.begins(printer, line.line_number, line.text);
    let outcome = macros.execute(printer, (line.line_number, line.text), ahead, onlooker).await;
    progress.stands_in = macros.stands_in;
    match outcome {
        Ok(()) => {
            onlooker.ended(printer);
            Ok(())
        }
        Err(message) => {
            progress.lines = line.line_number;
            stop(line.line_number, line.text, message)
        }
    }
}
