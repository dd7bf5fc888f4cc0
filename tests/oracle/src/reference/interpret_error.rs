//! Errors of the interpreter: a job could not be interpreted.

use std::fmt;

/// A job could not be interpreted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InterpretError {
    /// A number or a position is too large to be meant; the line, from 1.
    OutOfRange {
        /// The line.
        line: u32,
    },
    /// The file has more lines than a u32 counts.
    TooManyLines,
}

impl fmt::Display for InterpretError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { line } => write!(formatter, "line {line}: a number is out of range"),
            Self::TooManyLines => write!(formatter, "too many lines"),
        }
    }
}

impl std::error::Error for InterpretError {}
