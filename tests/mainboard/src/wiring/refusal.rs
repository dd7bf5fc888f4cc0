//! The error for a board file, profile or image that cannot be used.

use std::fmt;

/// A file that cannot be used: the place, the problem and the cure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The file, as the caller named it.
    pub file: String,
    /// The key, such as "motors.x.step"; empty for a problem of the whole file.
    pub key: String,
    /// The problem.
    pub problem: String,
    /// The cure.
    pub mend: String,
}

impl Refusal {
    pub(super) fn new(file: &str, key: impl Into<String>, problem: impl Into<String>, mend: impl Into<String>) -> Self {
        Self { file: file.to_owned(), key: key.into(), problem: problem.into(), mend: mend.into() }
    }

    /// A file that is not TOML, or has a missing, malformed or unknown key.
    pub(super) fn toml(file: &str, error: &toml::de::Error) -> Self {
        Self::new(
            file,
            "",
            error.to_string().trim_end().to_owned(),
            "the comments in config/boards/bench.toml and in config/profiles/ explain every key",
        )
    }

    /// A file that cannot be read.
    pub(super) fn unreadable(file: &str, error: &std::io::Error) -> Self {
        Self::new(file, "", format!("cannot be read: {error}"), "name an existing UTF-8 text file")
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}: ", self.file)?;
        if !self.key.is_empty() {
            write!(formatter, "{}: ", self.key)?;
        }
        write!(formatter, "{}; {}", self.problem, self.mend)
    }
}

impl std::error::Error for Refusal {}
