//! Errors of an import.

use std::fmt;

use crate::imported::{Gap, place};

/// Reason for which a file cannot be imported.
#[derive(Debug, PartialEq, Eq)]
pub enum ImportError {
    /// A file cannot be read: its name, and why.
    Read(String, String),
    /// The file is neither Klipper's nor Marlin's configuration.
    Unknown,
    /// A line that cannot be read: file, line, and what is expected.
    Line(String, usize, String),
    /// The machine's kinematics has no profile key.
    Machine(String, usize, String),
    /// The configuration does not say what machine it is: each part, and the files that
    /// could not be read.
    Identity(Vec<Gap>, Vec<String>),
    /// The result is not a valid profile: the reason.
    Profile(String),
}

impl fmt::Display for ImportError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(name, error) => write!(out, "{name}: cannot be read: {error}"),
            Self::Unknown => write!(
                out,
                "neither Klipper's printer.cfg (it has a section [printer]) nor Marlin's Configuration.h (it defines \
                 DEFAULT_AXIS_STEPS_PER_UNIT)"
            ),
            Self::Line(name, line, what) | Self::Machine(name, line, what) => {
                write!(out, "{}: {what}", place(name, *line))
            }
            Self::Identity(gaps, unread) => {
                write!(out, "no profile can be made of it, for another machine's values would stand in:")?;
                for gap in gaps {
                    write!(out, "\n  {gap}")?;
                }
                for file in unread {
                    write!(out, "\n  {file}")?;
                }
                write!(
                    out,
                    "\nmend these lines; or --assume takes the values of the built-in profile cartesian, to be replaced by hand before the machine moves"
                )
            }
            Self::Profile(reason) => write!(out, "no profile can be made of it: {reason}"),
        }
    }
}

impl std::error::Error for ImportError {}
