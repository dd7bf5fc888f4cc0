//! The faults of a file, with their places.

use std::fmt;

/// A file that could not be loaded: where it came from, the line and the problem.
///
/// Displays as one line, `ORIGIN:LINE: PROBLEM`.
#[derive(Debug)]
pub struct FileError {
    origin: String,
    line: Option<usize>,
    problem: Problem,
}

/// A fault of a file. Keys are full paths with dots, such as `homing.x.end`.
#[derive(Debug)]
#[non_exhaustive]
pub enum Problem {
    /// The file could not be read, and its name is not a built-in one.
    Read {
        /// The expected kind of file: "profile".
        what: &'static str,
        /// The name that was probably meant, of those that need no file.
        meant: Option<&'static str>,
        /// Names that need no file.
        built_in: Vec<&'static str>,
        /// The operating system's reason.
        error: std::io::Error,
    },
    /// The text is not TOML.
    Syntax(String),
    /// A key that such a file does not have.
    UnknownKey {
        /// The key.
        key: String,
        /// The key that was probably meant.
        meant: Option<String>,
        /// The keys that its table has, in words.
        expected: String,
    },
    /// A required key that is missing.
    MissingKey {
        /// The key.
        key: String,
        /// Values, in words and with their unit.
        expected: String,
    },
    /// A value of the wrong type, or an unknown word.
    WrongType {
        /// The key.
        key: String,
        /// The value as written in the text.
        value: String,
        /// The right values, in words.
        expected: String,
    },
    /// A value outside its range, or one that contradicts another.
    OutOfRange {
        /// The key.
        key: String,
        /// The value as written in the text.
        value: String,
        /// The right values, in words and with their unit.
        expected: String,
    },
}

impl FileError {
    /// An error of the file `origin` (a path or a name).
    pub fn new(origin: &str, line: Option<usize>, problem: Problem) -> FileError {
        FileError { origin: origin.to_owned(), line, problem }
    }

    /// The path or built-in name of the file.
    pub fn origin(&self) -> &str {
        &self.origin
    }

    /// Line of the text, counted from 1; `None` if the problem has no line, as a key missing
    /// at the top level.
    pub fn line(&self) -> Option<usize> {
        self.line
    }

    /// Returns the fault.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// Full path of the key to blame, if it is a key.
    pub fn key(&self) -> Option<&str> {
        match &self.problem {
            Problem::UnknownKey { key, .. }
            | Problem::MissingKey { key, .. }
            | Problem::WrongType { key, .. }
            | Problem::OutOfRange { key, .. } => Some(key),
            Problem::Read { .. } | Problem::Syntax(_) => None,
        }
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.origin)?;
        if let Some(line) = self.line {
            write!(f, "{line}:")?;
        }
        write!(f, " {}", self.problem)
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Problem::Read { what, meant, built_in, error } if error.kind() == std::io::ErrorKind::NotFound => {
                let names = built_in.join(", ");
                write!(f, "there is no such file, and no built-in {what} of this name ({names})")?;
                meant.map_or(Ok(()), |meant| write!(f, ": did you mean {meant}?"))
            }
            Problem::Read { what, meant, built_in, error } => {
                write!(f, "cannot read {what}: {error}; ")?;
                if let Some(meant) = meant {
                    write!(f, "did you mean {meant}? ")?;
                }
                write!(
                    f,
                    "{} built-in {what}s are {}",
                    if meant.is_some() { "The" } else { "the" },
                    built_in.join(", ")
                )
            }
            Problem::Syntax(message) => write!(f, "not valid TOML: {message}"),
            Problem::UnknownKey { key, meant: Some(meant), .. } => {
                write!(f, "unknown key \"{key}\": did you mean \"{meant}\"?")
            }
            Problem::UnknownKey { key, expected, .. } => write!(f, "unknown key \"{key}\", expected {expected}"),
            Problem::MissingKey { key, expected } => write!(f, "missing key \"{key}\", expected {expected}"),
            Problem::WrongType { key, value, expected } | Problem::OutOfRange { key, value, expected } => {
                write!(f, "{key} = {value}: expected {expected}")
            }
        }
    }
}

impl std::error::Error for FileError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match &self.problem {
            Problem::Read { error, .. } => Some(error),
            _ => None,
        }
    }
}
