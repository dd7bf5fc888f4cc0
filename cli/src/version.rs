//! How the command names itself.

/// Version and commit, `0.1.0 (commit abcdef0)`: what `--version` and M115 say, as a board does.
pub const VERSION: &str = env!("FERROSTEP_VERSION");
