//! Why a file is refused.

use std::fmt;

/// A file that cannot be used: where, what is wrong, and how to mend it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The file, as the caller named it.
    pub file: String,
    /// The key, such as "motors.x.step"; empty where the whole file is meant.
    pub key: String,
    /// What is wrong.
    pub problem: String,
    /// How to mend it.
    pub mend: String,
}

impl Refusal {
    pub(super) fn new(file: &str, key: impl Into<String>, problem: impl Into<String>, mend: impl Into<String>) -> Self {
        Self { file: file.to_owned(), key: key.into(), problem: problem.into(), mend: mend.into() }
    }

    /// A file that is no TOML, or lacks a key, or has one too many.
    pub(super) fn toml(file: &str, error: &toml::de::Error) -> Self {
        Self::new(
            file,
            "",
            error.to_string().trim_end().to_owned(),
            "boards/bench.toml and the profiles explain the keys",
        )
    }

    /// A file that cannot be read at all.
    pub(super) fn unreadable(file: &str, error: &std::io::Error) -> Self {
        Self::new(file, "", format!("cannot be read: {error}"), "name a file that exists and is UTF-8 text")
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
