//! Temporary files of outputs, which are removed when a signal ends the process.

use std::io;
use std::path::Path;

use tempfile::NamedTempFile;

use super::parts;
#[cfg(unix)]
use super::signals;

/// Creates a temporary file that is removed if a signal ends the process.
pub fn begin(make: impl FnOnce() -> io::Result<NamedTempFile>) -> io::Result<NamedTempFile> {
    #[cfg(unix)]
    signals::watch()?;
    let mut parts = parts::lock();
    let part = make()?;
    parts.push(part.path().to_path_buf());
    Ok(part)
}

/// Renames a temporary file to its final name.
pub fn keep(part: NamedTempFile, target: &Path) -> io::Result<()> {
    end(part, |part| part.persist(target).map(drop).map_err(|error| error.error))
}

/// Removes a temporary file.
pub fn discard(part: NamedTempFile) {
    // Another process may have removed it, or its folder.
    let _ = end(part, NamedTempFile::close);
}

fn end(part: NamedTempFile, how: impl FnOnce(NamedTempFile) -> io::Result<()>) -> io::Result<()> {
    let mut parts = parts::lock();
    let path = part.path().to_path_buf();
    let outcome = how(part);
    parts.retain(|other| *other != path);
    outcome
}
