//! The memory card: commands for its files (`files`), the print (`print`) with its two kinds of
//! files (`text`, `job`), commands allowed in them (`in_file`), and the lines of a host that are
//! written (`write`). The card itself has a separate task ([`ferrostep_card`]).

mod files;
mod in_file;
mod job;
pub(crate) mod print;
mod task;
mod text;
mod write;
