//! Jobs that are planned here and executed by the board: writing, reading and looking into GPRE files.

mod inspect;
mod play;
mod prepare;
mod script;
mod summary;
mod thumbnail;

pub use inspect::{InspectError, inspect};
pub use play::play;
pub use prepare::{PrepareError, Prepared, Target, prepare};
pub use script::Script;
pub use summary::PreparedSummary;

/// Blocks in the look-ahead ring while a job is prepared: more than any stopping distance has.
pub const LOOK_AHEAD_BLOCKS: usize = 65_536;
