//! The browser that pages are tested in.
#![allow(clippy::expect_used, reason = "without it no test can say anything")]

use std::path::PathBuf;

/// The browser: `FERROSTEP_CHROMIUM`, or the first of these on the path.
///
/// # Panics
/// Chromium is missing.
pub fn chromium() -> PathBuf {
    if let Some(named) = std::env::var_os("FERROSTEP_CHROMIUM") {
        return named.into();
    }
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()).collect();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found =
        names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|at| at.is_file());
    found.expect("Chromium is missing: install it (Debian: apt-get install chromium), or name it in FERROSTEP_CHROMIUM")
}
