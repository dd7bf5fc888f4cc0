//! The board and the profile that an image is built for: what the environment names, checked. For
//! build scripts: it also tells cargo which files were read.
//!
//! `FERROSTEP_BOARD` names the board, by name or path; the bench without it.
//! `FERROSTEP_BOOT_OFFSET` moves the image to another place of its flash. `FERROSTEP_PROFILE` names
//! another profile than the board's, by name or path. `cargo xtask firmware` sets all three.

use std::env;

use ferrostep_printer::Profile;

use crate::board::Board;
use crate::{DEFAULT, builtin_text, fit, load};

/// The board, with its image where the environment puts it.
///
/// # Errors
/// The board's file has a fault, or no image may begin there; errors name file, line and key,
/// or the variable.
pub fn board() -> Result<Board, String> {
    let name = variable("FERROSTEP_BOARD").unwrap_or_else(|| DEFAULT.to_owned());
    watch(&name, builtin_text);
    let board = load(&name).map_err(|error| error.to_string())?;
    match variable("FERROSTEP_BOOT_OFFSET") {
        Some(text) => {
            let offset = text.parse().map_err(|_| format!("FERROSTEP_BOOT_OFFSET={text}: expected bytes"))?;
            board.at_boot_offset(offset)
        }
        None => Ok(board),
    }
}

/// The board and its machine, which fit each other.
///
/// # Errors
/// As [`board`]; the profile's file has a fault, or does not fit the board.
pub fn machine() -> Result<(Board, Profile), String> {
    let board = board()?;
    let name = variable("FERROSTEP_PROFILE").unwrap_or_else(|| board.profile.clone());
    watch(&name, ferrostep_profiles::builtin_text);
    let profile = ferrostep_profiles::load(&name).map_err(|error| error.to_string())?;
    fit::check(&board, &profile, &name).map_err(|error| error.to_string())?;
    Ok((board, profile))
}

/// A variable of the environment; the build script runs again when it changes.
fn variable(name: &str) -> Option<String> {
    println!("cargo:rerun-if-env-changed={name}");
    env::var(name).ok()
}

/// Reruns the build script when a file changes that is not built in.
fn watch(name_or_path: &str, builtin: impl Fn(&str) -> Option<&'static str>) {
    if builtin(name_or_path).is_none() {
        println!("cargo:rerun-if-changed={name_or_path}");
    }
}
