//! Result of an import: the profile, and the outcome of each setting.

use std::fmt;

/// A setting of the file, and what became of it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Row {
    /// The file.
    pub file: String,
    /// The row's line, from 1.
    pub line: usize,
    /// The setting, with its section: `[stepper_x] microsteps`.
    pub key: String,
    /// The row's value, on one line.
    pub value: String,
    /// The profile's key that says it, with its value there; `None` if it is not kept.
    pub kept: Option<String>,
    /// Reason for which it is not kept, or is kept in another form.
    pub why: String,
    /// True if a profile may not have this value and has another one instead.
    pub refused: bool,
}

/// A part of the machine's identity that the file does not say in a way that can be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Key of the profile.
    pub path: String,
    /// File and line of the setting that should give it a value.
    pub place: Option<(String, usize)>,
    /// Description of the problem.
    pub what: String,
}

impl fmt::Display for Gap {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.place {
            Some((name, line)) => write!(out, "{}: {}", place(name, *line), self.what),
            None => write!(out, "{}: {}", self.path, self.what),
        }
    }
}

/// A profile that was made of a configuration.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Imported {
    /// The profile's text, which has passed all checks of profiles.
    pub profile: String,
    /// All settings, in the order of the files.
    pub rows: Vec<Row>,
    /// Keys of the profile that the configuration does not set, with the values used instead.
    pub assumed: Vec<String>,
    /// Files that are included and could not be read.
    pub unread: Vec<String>,
    /// Keys of the machine's identity that the file does not set, assumed because the
    /// caller has allowed it.
    pub by_permission: Vec<String>,
    /// Keys whose value in the file a profile may not have, with the value used instead.
    pub substituted: Vec<String>,
    /// Assumed keys of homing and of sensors.
    pub homing: Vec<String>,
    /// Assumed keys with the built-in profile's values, which may be another machine's.
    pub built_in: Vec<String>,
}

impl Imported {
    /// The settings whose value a profile may not have.
    pub fn refused(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| row.refused)
    }
}

/// A file's name with a line. The settings of a running Klipper have no lines that a
/// person could look up.
#[must_use]
pub fn place(name: &str, line: usize) -> String {
    if name.starts_with("http://") { name.to_owned() } else { format!("{name}:{line}") }
}
