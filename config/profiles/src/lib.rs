//! Machines as TOML: the built-in profiles, profiles from files, and the checks both pass.
//!
//! A key is one line of code that reads it, with its range, its default and its meaning
//! (`src/machine.rs` and its neighbours); the book's table of keys is made from the same
//! lines ([`schema`]). Unknown keys are refused, so that a misspelt one cannot quietly leave
//! a value at a default.
#![forbid(unsafe_code)]

mod axes;
mod backlash;
mod bed_screws;
mod bltouch;
mod drivers;
pub mod error_budget;
mod extrusion;
mod fans;
mod filament_sensor;
mod heaters;
mod homing;
mod machine;
mod macros;
mod mesh;
mod motion;
mod names;
mod pause;
pub mod response;
mod rules;
mod skew;
mod supply;
mod tools;
mod z_motors;

use error_budget::ErrorBudget;
use ferrostep_printer::Profile;
use machine::Machine;

use ferrostep_checked_toml::{Checked, Reader, Schema, line_of_key};
pub use ferrostep_checked_toml::{FileError as ProfileError, Problem};
pub use rules::{PlannedBy, RuleKeys};
pub use z_motors::heights_by_motors;

/// Names and texts of the profiles that need no file.
const BUILTIN: [(&str, &str); 3] = [
    ("cartesian", include_str!("../cartesian.toml")),
    ("corexy", include_str!("../corexy.toml")),
    ("prusa-mini", include_str!("../prusa-mini.toml")),
];

/// Names that [`load`] knows without a file, in alphabetical order.
pub fn builtin_names() -> impl Iterator<Item = &'static str> {
    BUILTIN.iter().map(|(name, _)| *name)
}

/// Text of the built-in profile of this name.
pub fn builtin_text(name: &str) -> Option<&'static str> {
    BUILTIN.iter().find(|(builtin, _)| *builtin == name).map(|(_, text)| *text)
}

/// Loads a built-in profile by its name, or else the file at this path.
///
/// # Errors
///
/// [`Problem::Read`] if the file cannot be read, is not UTF-8 or is larger than 1 MiB;
/// otherwise as [`parse`].
pub fn load(name_or_path: &str) -> Result<Profile, ProfileError> {
    parse(&text(name_or_path)?, name_or_path)
}

/// The error for a value that the profile may have but its board cannot serve: `key` is the full
/// path, `expected` names the values that the board can.
pub fn refuse(name_or_path: &str, key: &str, value: &str, expected: &str) -> ProfileError {
    let line = text(name_or_path).ok().and_then(|text| line_of_key(&text, key));
    let problem = Problem::OutOfRange { key: key.to_owned(), value: value.to_owned(), expected: expected.to_owned() };
    ProfileError::new(name_or_path, line, problem)
}

/// The text of a built-in profile, or else of the file at this path, unchecked.
///
/// # Errors
/// [`Problem::Read`], as [`load`].
pub fn text(name_or_path: &str) -> Result<String, ProfileError> {
    match builtin_text(name_or_path) {
        Some(text) => Ok(text.to_owned()),
        None => ferrostep_checked_toml::read(name_or_path, "profile", builtin_names()),
    }
}

/// Parses and checks a profile; `origin` (a path or a name) precedes the line number in errors.
///
/// The texts in a [`Profile`] are `'static`, so each call leaks them (its names, at most 100 bytes,
/// and its macros, at most 4096): a program reads the profile of its machine once.
///
/// # Errors
///
/// The first problem found: TOML syntax, then unknown, missing or mistyped keys, then values out of
/// their range, then values that contradict each other.
pub fn parse(text: &str, origin: &str) -> Result<Profile, ProfileError> {
    parse_with_rules(text, origin).map(|(profile, _)| profile)
}

/// Parses a profile as [`parse`] does, with the rules that the printer's moves are planned by.
///
/// # Errors
/// As [`parse`].
pub fn parse_with_rules(text: &str, origin: &str) -> Result<(Profile, RuleKeys), ProfileError> {
    let Checked { value: Machine { profile, texts, rules, .. }, hash } = read(text, origin)?;
    let [name, model_names, macros] = texts.map(|text| &*Box::leak(text.into_boxed_str()));
    Ok((Profile { name, model_names, macros, plan_hash: hash, ..profile }, rules))
}

/// Reads the error budget and the frame from a profile's text. The accelerations that follow from
/// them are in the [`Profile`].
///
/// # Errors
/// As [`parse`].
pub fn error_budget(text: &str, origin: &str) -> Result<ErrorBudget, ProfileError> {
    Ok(read(text, origin)?.value.budget)
}

fn read(text: &str, origin: &str) -> Result<Checked<Machine>, ProfileError> {
    let reader = Reader::new(text, origin)?;
    let machine = machine::profile(&reader.root());
    reader.finish(machine)
}

/// The keys of a profile.
pub fn schema() -> Schema {
    Reader::describe(machine::profile)
}
