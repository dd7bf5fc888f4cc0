//! Files on a memory card: which is selected, how far its print is, what is written.
//!
//! The card itself has a task of its own ([`ferrostep_card`]); here is what commands do with it (`commands`), the print
//! (`print`) with its two kinds of files (`text`, `job`), what may stand in them (`in_file`), and the lines of a host that are written (`write`).

pub(crate) mod state;

pub use crate::commands::card::print::{HostLines, HostText};
pub(crate) use state::{Card, Job, Selected};
