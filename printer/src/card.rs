//! Files on a memory card: which is selected, how far its print is, what is written.
//!
//! The card itself has a task of its own ([`ferrostep_card`]); here is what commands do with it (`commands`), the print
//! (`print`) with its two kinds of files (`text`, `job`), what may stand in them (`in_file`), and the lines of a host that are written (`write`).

mod commands;
mod in_file;
mod job;
mod print;
mod state;
mod task;
mod text;
mod write;

pub use print::{HostLines, HostText};
pub(crate) use state::{Card, Job, Selected};
