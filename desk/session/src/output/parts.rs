//! The list of temporary files, which a signal removes.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// All temporary files. The lock is held while one is made, renamed or removed, and while the
/// signal thread removes them all, so that it misses none.
static PARTS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Locks the list.
pub fn lock() -> MutexGuard<'static, Vec<PathBuf>> {
    // A panic cannot leave a list of paths inconsistent.
    PARTS.lock().unwrap_or_else(PoisonError::into_inner)
}
