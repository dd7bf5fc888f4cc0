//! Jobs that are planned here and executed by the board: writing, reading and looking into GPRE files.

mod entry;
mod inspect;
mod packets;
mod play;
mod prepare;
mod script;
mod summary;
mod thumbnail;

pub use inspect::{InspectError, Shown, inspect};
pub use play::{play, play_from};
pub use prepare::{PrepareError, Prepared, Target, prepare};
pub use script::Script;
pub use summary::PreparedSummary;
pub use thumbnail::take as take_thumbnail;

/// Blocks in the look-ahead ring while a job is prepared: more than any stopping distance has.
pub const LOOK_AHEAD_BLOCKS: usize = 65_536;
