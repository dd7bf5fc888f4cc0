//! A profile from another firmware's configuration: Klipper's `printer.cfg` or Marlin's `Configuration.h`.
//!
//! Every setting of the file ends up in a [`Row`]: what the profile keeps of it, or why it has no place there. Keys that a profile needs
//! and the file does not say come from the built-in profile `cartesian` and are named ([`Imported::assumed`]).

mod condition;
mod draft;
mod expression;
mod klipper;
mod klipper_map;
mod marlin;
mod marlin_map;
mod sensor;

use std::fmt;
use std::path::{Path, PathBuf};

/// Longest file that is read, bytes; files of printers have less than a tenth.
const MAX_BYTES: u64 = 1 << 20;

/// Most included files.
const MAX_INCLUDES: usize = 100;

/// A setting of the file, and what became of it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Row {
    /// The file.
    pub file: String,
    /// Its line, from 1.
    pub line: usize,
    /// The setting, with its section: `[stepper_x] microsteps`.
    pub key: String,
    /// Its value, on one line.
    pub value: String,
    /// The profile's key that says it, with its value there; `None` if it is not kept.
    pub kept: Option<String>,
    /// Why it is not kept, or is kept in another form.
    pub why: String,
}

/// A profile that was made of a configuration.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Imported {
    /// The profile's text, which has passed all checks of profiles.
    pub profile: String,
    /// All settings, in the order of the files.
    pub rows: Vec<Row>,
    /// Keys of the profile that the configuration does not say, with the values that stand in for them.
    pub assumed: Vec<String>,
}

/// Why a file cannot be imported.
#[derive(Debug, PartialEq, Eq)]
pub enum ImportError {
    /// A file cannot be read: its name, and why.
    Read(String, String),
    /// It is the configuration of neither firmware.
    Unknown,
    /// A line that cannot be read: file, line, and what is expected.
    Line(String, usize, String),
    /// The machine is of a kind that no profile describes.
    Machine(String, usize, String),
    /// What came of it is no profile: the reason.
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
            Self::Line(file, line, what) | Self::Machine(file, line, what) => write!(out, "{file}:{line}: {what}"),
            Self::Profile(reason) => write!(out, "no profile can be made of it: {reason}"),
        }
    }
}

impl std::error::Error for ImportError {}

/// Makes a profile of a file, and of those that it includes.
///
/// # Errors
/// See [`ImportError`]; nothing is made then.
pub fn read(path: &Path) -> Result<Imported, ImportError> {
    let name = path.file_name().map_or_else(|| crate::input::name(path), |name| crate::terminal::name(Path::new(name)));
    let text = text_of(path).map_err(|error| ImportError::Read(crate::input::name(path), error))?;
    let folder = path.parent().map_or_else(PathBuf::new, Path::to_path_buf);
    of_text(&name, &text, &mut |include| files(&folder, include))
}

/// A file's name and its text, or why it cannot be read.
pub type Included = Result<Vec<(String, String)>, String>;

/// As [`read`], of a text; `include` returns the files of a name that may have a `*`.
///
/// # Errors
/// As [`read`].
pub fn of_text(name: &str, text: &str, include: &mut dyn FnMut(&str) -> Included) -> Result<Imported, ImportError> {
    if marlin::is_one(text) {
        let beside = include("Configuration_adv.h").unwrap_or_default();
        return marlin_map::map(&marlin::parse(name, text, &beside)?);
    }
    let config = klipper::parse(name, text, include)?;
    if config.section("printer").is_none() {
        return Err(ImportError::Unknown);
    }
    klipper_map::map(&config)
}

fn text_of(path: &Path) -> Result<String, String> {
    use std::io::Read;
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(|error| error.to_string())?;
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err("larger than 1 MiB".to_owned());
    }
    String::from_utf8(bytes).map_err(|_| "not UTF-8 text".to_owned())
}

/// The files of a name beside the configuration; the last part of the name may have a `*`.
fn files(folder: &Path, include: &str) -> Included {
    let path = folder.join(include);
    let (Some(parent), Some(pattern)) = (path.parent(), path.file_name().and_then(|name| name.to_str())) else {
        return Err("this is not the name of a file".to_owned());
    };
    let Some((start, end)) = pattern.split_once('*') else {
        return Ok(vec![(include.to_owned(), text_of(&path)?)]);
    };
    let entries = std::fs::read_dir(parent).map_err(|error| error.to_string())?;
    let mut names: Vec<String> = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.retain(|name| name.len() >= start.len() + end.len() && name.starts_with(start) && name.ends_with(end));
    names.sort();
    names.into_iter().map(|name| Ok((name.clone(), text_of(&parent.join(name))?))).collect()
}

/// A text of one line, cut where it is long.
fn shown(text: &str) -> String {
    const MAX: usize = 60;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= MAX {
        return line;
    }
    line.chars().take(MAX - 1).chain(['…']).collect()
}
