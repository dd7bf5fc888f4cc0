//! Jobs that are planned here and executed by the board: writing, reading and
//! inspecting GPRE files.

mod entry;
mod inspect;
mod part_reader;
mod play;
mod play_wide;
mod prepare;
mod script;
mod stopped;
mod summary;
mod thumbnail;

pub use inspect::{InspectError, Shown, inspect};
pub use play::{play, play_from};
pub use prepare::{LOOK_AHEAD_BLOCKS, PrepareError, Prepared, Target, prepare};
pub use script::Script;
pub use summary::PreparedSummary;
pub use thumbnail::take as take_thumbnail;
