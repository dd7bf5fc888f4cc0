//! A profile from another firmware's configuration: Klipper's `printer.cfg` or Marlin's `Configuration.h`, or what a running one says of itself.
//!
//! Every setting of the file ends up in a [`Row`]: what the profile keeps of it, or why it has no place there. Keys that a profile needs
//! and the file does not say come from the built-in profile `cartesian` and are named ([`Imported::assumed`]).

mod c_macros;
mod c_tokens;
mod condition;
mod draft;
mod effort;
mod expression;
mod glob;
mod http;
mod klipper;
mod klipper_map;
mod mark;
mod marlin;
mod marlin_map;
mod marlin_report;
mod moonraker;
mod nearest;
mod paths;
mod rows;
mod sensor;
mod text;

use std::fmt;
use std::path::{Path, PathBuf};

pub use http::Url;
pub use mark::is_untouched;
pub use moonraker::read_moonraker;

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
    /// A profile may not have this value: another one stands there.
    pub refused: bool,
}

/// A part of the machine's identity that the file does not say in a way that can be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gap {
    /// The profile's key.
    pub path: String,
    /// File and line of the setting that should say it.
    pub place: Option<(String, usize)>,
    /// What is wrong with it.
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
    /// Keys of the profile that the configuration does not say, with the values that stand in for them.
    pub assumed: Vec<String>,
    /// Files that are included and could not be read.
    pub unread: Vec<String>,
    /// What the machine is and the file does not say: assumed because the caller has allowed it.
    pub by_permission: Vec<String>,
    /// Keys whose value in the file a profile may not have, with what stands there.
    pub substituted: Vec<String>,
    /// Of the assumed ones those of homing and of sensors.
    pub homing: Vec<String>,
    /// Of the assumed ones those that are the built-in profile's, which may be another machine's.
    pub built_in: Vec<String>,
}

impl Imported {
    /// The settings whose value a profile may not have.
    pub fn refused(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| row.refused)
    }
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
    /// The configuration does not say what machine it is: each part, and the files that could not be read.
    Identity(Vec<Gap>, Vec<String>),
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

/// A file's name with a line. The settings of a running Klipper have no lines that a person could look up.
#[must_use]
pub fn place(name: &str, line: usize) -> String {
    if name.starts_with("http://") { name.to_owned() } else { format!("{name}:{line}") }
}

/// Makes a profile of a file, and of those that it includes; `assume` lets the built-in profile stand in for what the machine is.
///
/// # Errors
/// See [`ImportError`]; nothing is made then.
pub fn read(path: &Path, assume: bool) -> Result<Imported, ImportError> {
    let name = name_of(path);
    let text = text::of_file(path).map_err(|error| ImportError::Read(crate::input::name(path), error))?;
    let folder = path.parent().map_or_else(PathBuf::new, Path::to_path_buf);
    let imported = of_text_with(&name, &text, &mut |include| files(&folder, include), assume)?;
    Ok(imported)
}

/// Makes a profile of what a running Marlin says to M115 and to M503. With a file of its configuration, that says what the printer does not,
/// and the printer's numbers hold.
///
/// # Errors
/// It is not Marlin or does not report its settings; or as [`read`].
pub fn of_running_marlin(
    name: &str,
    about: &[String],
    settings: &[String],
    file: Option<&Path>,
    assume: bool,
) -> Result<Imported, ImportError> {
    let mut definitions = match file {
        Some(path) => definitions_of(path)?,
        None => marlin::Definitions::of_running(marlin_report::running(about)),
    };
    let added = marlin_report::add(about, settings, &mut definitions);
    added.map_err(|error| ImportError::Read(name.to_owned(), error))?;
    marlin_map::map(&definitions, assume)
}

/// The definitions of a file of Marlin's, and of those that it includes.
fn definitions_of(path: &Path) -> Result<marlin::Definitions, ImportError> {
    let (name, folder) = (name_of(path), path.parent().map_or_else(PathBuf::new, Path::to_path_buf));
    let text = text::of_file(path).map_err(|error| ImportError::Read(crate::input::name(path), error))?;
    let text = text::with_line_ends(&text);
    if !marlin::is_one(&name, &text) {
        let what = "beside a running Marlin, its Configuration.h is expected".to_owned();
        return Err(ImportError::Read(crate::input::name(path), what));
    }
    marlin::parse(&name, text.trim_start_matches('\u{feff}'), &mut |include| files(&folder, include))
}

/// The name of a file in rows and messages.
fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| crate::input::name(path), |name| ferrostep_host::printable::name(Path::new(name)))
}

/// A file's name and its text, or why it cannot be read.
pub type Included = Result<Vec<(String, String)>, String>;

/// As [`read`], of a text, with nothing assumed; `include` returns the files of a name, relative to the text's, that may stand for
/// several.
///
/// # Errors
/// As [`read`].
pub fn of_text(name: &str, text: &str, include: &mut dyn FnMut(&str) -> Included) -> Result<Imported, ImportError> {
    of_text_with(name, text, include, false)
}

/// As [`of_text`], with leave to assume.
///
/// # Errors
/// As [`read`].
pub fn of_text_with(
    name: &str,
    text: &str,
    include: &mut dyn FnMut(&str) -> Included,
    assume: bool,
) -> Result<Imported, ImportError> {
    let text = text::with_line_ends(text);
    if marlin::is_one(name, &text) {
        let text = text.trim_start_matches('\u{feff}');
        return marlin_map::map(&marlin::parse(name, text, include)?, assume);
    }
    if text.starts_with('\u{feff}') {
        let what =
            "the file begins with a byte order mark, which Klipper refuses as well: save it as UTF-8 without one";
        return Err(ImportError::Line(name.to_owned(), 1, what.to_owned()));
    }
    let config = klipper::parse(name, &text, include)?;
    if config.section("printer").is_none() {
        return Err(ImportError::Unknown);
    }
    klipper_map::map(&config, assume)
}

/// The files of a name, relative to the folder of the configuration; it may stand for several.
fn files(folder: &Path, include: &str) -> Included {
    if !glob::is_pattern(include) {
        return Ok(vec![(include.to_owned(), text::of_file(&folder.join(include))?)]);
    }
    let names = glob::matching(folder, include);
    names.into_iter().map(|name| Ok((name.clone(), text::of_file(&folder.join(&name))?))).collect()
}

/// The name of a file that another one includes, relative to where the first one is.
fn beside(file: &str, include: &str) -> String {
    match file.rsplit_once('/') {
        Some((folder, _)) if !include.starts_with('/') => format!("{folder}/{include}"),
        _ => include.to_owned(),
    }
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
