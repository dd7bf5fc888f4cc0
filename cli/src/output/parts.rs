//! The list of temporary files, for whoever must remove them all.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// All temporary files. The lock is held while one is made, renamed or removed, and while the signal thread removes them all, so
/// that none is missed in between.
static PARTS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Locks the list.
pub fn lock() -> MutexGuard<'static, Vec<PathBuf>> {
    // A panic cannot leave a list of paths inconsistent.
    PARTS.lock().unwrap_or_else(PoisonError::into_inner)
}
