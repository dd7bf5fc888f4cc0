//! The command's version.

/// Version and commit, `0.1.0 (commit abcdef0)`: in `--version` and M115, as on a board.
pub const VERSION: &str = env!("FERROSTEP_VERSION");
