//! Error that ends the sending of a job.

use std::fmt;
use std::io;

/// Reason why a job was not sent to its end.
#[derive(Debug)]
pub enum SendError {
    /// The board is gone.
    Port(io::Error),
    /// The board does not answer; its last lines.
    Silent(Vec<String>),
    /// The board answers but does not take the job: it does not know prepared jobs, is halted, or
    /// receives another one; its last lines.
    NotTaken(Vec<String>),
    /// The board halted while it received G-code; the line in which it says so.
    Halted(String),
    /// [`Watch::wants_end`](super::Watch::wants_end) returned true; the transfer of a prepared job
    /// was aborted.
    Asked,
}

impl fmt::Display for SendError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(error) => write!(out, "the connection to the board is lost: {error}"),
            Self::Silent(heard) => write_heard(out, "the board does not answer", heard),
            Self::NotTaken(heard) => write_heard(out, "the board does not take the job", heard),
            Self::Halted(line) => write!(out, "the board has halted: {line}"),
            Self::Asked => out.write_str("stopped by Ctrl-C"),
        }
    }
}

/// Writes the error and the board's last lines.
fn write_heard(out: &mut fmt::Formatter<'_>, what: &str, heard: &[String]) -> fmt::Result {
    write!(out, "{what}")?;
    if !heard.is_empty() {
        write!(out, "; its last lines:")?;
    }
    heard.iter().try_for_each(|line| write!(out, "\n  {line}"))
}

impl std::error::Error for SendError {}

impl From<io::Error> for SendError {
    fn from(error: io::Error) -> Self {
        Self::Port(error)
    }
}
