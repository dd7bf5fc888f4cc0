//! The desk: the whole machine in virtual time, and what the `ferrostep` command is made of.

pub mod desk;
pub mod gpre;
pub mod input;
pub mod job;
pub mod method_comparison;
pub mod output;
pub mod record;
pub mod report;
pub mod send;
#[cfg(unix)]
pub mod serial_line;
pub mod session;
pub mod terminal;

/// Version and commit, `0.1.0 (commit abcdef0)`: what `--version` and M115 say, as a board does.
pub const VERSION: &str = env!("FERROSTEP_VERSION");
