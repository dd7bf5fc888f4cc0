//! Machines as TOML: the built-in profiles, profiles from files, and the checks both pass.
//!
//! The three built-in profiles are the files next to this crate's `Cargo.toml` and document every key. All keys
//! are required but those that they show as absent, and no others are known, so that a misspelt key cannot quietly
//! leave a value at a default.
#![forbid(unsafe_code)]

mod check;
mod convert;
mod error;
mod file;
mod locate;

use std::io::Read;

use ferrostep_printer::Profile;

pub use error::{Problem, ProfileError};

/// Names and texts of the profiles that need no file.
const BUILTIN: [(&str, &str); 3] = [
    ("cartesian", include_str!("../cartesian.toml")),
    ("corexy", include_str!("../corexy.toml")),
    ("prusa-mini", include_str!("../prusa-mini.toml")),
];

/// Longest profile that is read, bytes. A path given by mistake may name a print of many megabytes, or a device
/// that never ends.
const MAX_BYTES: u64 = 1 << 20;

/// Names that [`load`] knows without a file, in alphabetical order.
pub fn builtin_names() -> impl Iterator<Item = &'static str> {
    BUILTIN.iter().map(|(name, _)| *name)
}

/// Text of a built-in profile, `None` if there is none of this name.
pub fn builtin_text(name: &str) -> Option<&'static str> {
    BUILTIN.iter().find(|(builtin, _)| *builtin == name).map(|(_, text)| *text)
}

/// Loads a built-in profile by its name, or else the file at this path.
///
/// # Errors
///
/// [`Problem::Read`] if the file cannot be read, is not UTF-8 or is larger than 1 MiB; otherwise as [`parse`].
pub fn load(name_or_path: &str) -> Result<Profile, ProfileError> {
    if let Some(text) = builtin_text(name_or_path) {
        return parse(text, name_or_path);
    }
    let text = read(name_or_path).map_err(|error| ProfileError::new(name_or_path, None, Problem::Read(error)))?;
    parse(&text, name_or_path)
}

/// Parses and checks a profile; `origin` (a path or a name) stands in front of the line number in errors.
///
/// The name in a [`Profile`] is `'static`, so each successful call leaks it (at most 32 bytes): a program reads the
/// profile of its machine once.
///
/// # Errors
///
/// The first problem found: TOML syntax, then unknown, missing or mistyped keys, then values out of their range, then
/// values that contradict each other.
pub fn parse(text: &str, origin: &str) -> Result<Profile, ProfileError> {
    let file = toml::from_str(text).map_err(|error| locate::explain(&error, text, origin))?;
    convert::profile(&file, &check::Checker::new(text, origin))
}

/// Reads a whole text file of at most [`MAX_BYTES`].
fn read(path: &str) -> std::io::Result<String> {
    let mut text = String::new();
    let mut file = std::fs::File::open(path)?.take(MAX_BYTES + 1);
    // A size limit met in the middle of a character is still a size limit, so bytes first, UTF-8 second.
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(std::io::Error::new(std::io::ErrorKind::FileTooLarge, "larger than 1 MiB, so not a profile"));
    }
    bytes.as_slice().read_to_string(&mut text)?;
    Ok(text)
}
