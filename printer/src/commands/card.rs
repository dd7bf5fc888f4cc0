//! The memory card: what commands do with its files (`files`), the print (`print`) with its two kinds of files (`text`, `job`), what may stand
//! in them (`in_file`), and the lines of a host that are written (`write`). The card itself has a task of its own ([`ferrostep_card`]).

mod files;
mod in_file;
mod job;
pub(crate) mod print;
mod task;
mod text;
mod write;
