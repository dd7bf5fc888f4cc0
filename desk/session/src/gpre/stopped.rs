//! Errors in the execution of a part of a prepared job.

use ferrostep_gpre::Fault;
use ferrostep_printer::{CommandError, Failure};

use crate::job::JobError;

/// Reason for which a frame or a packet was not executed to its end.
pub struct Stopped {
    /// Source line.
    line: Option<u32>,
    message: String,
}

impl Stopped {
    /// Creates the error of a line with this reason.
    pub fn new(line: u32, message: String) -> Self {
        Self { line: Some(line), message }
    }

    /// Creates the error of a line from a command's error.
    pub fn at_line(line: u32, error: &CommandError) -> Self {
        Self::new(line, error.to_string())
    }

    /// The error of a frame or packet of this number, which begins at this byte.
    pub fn at(self, frame: u32, offset: u64) -> JobError {
        JobError::Prepared { frame: Some(frame), line: self.line, offset, message: self.message }
    }

    /// Creates the error of a command's text from its failure.
    pub fn at_command(line: u32, text: &str, failure: &Failure) -> Self {
        Self::new(line, format!("{text:?}: {failure}"))
    }
}

impl From<Fault> for Stopped {
    fn from(fault: Fault) -> Self {
        Self { line: None, message: fault.to_string() }
    }
}
