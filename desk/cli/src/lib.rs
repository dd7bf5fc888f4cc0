//! The desk: the whole machine in virtual time, and the parts of the `ferrostep` command.

pub mod black_box;
pub mod calibrate;
#[cfg(unix)]
pub mod card_image;
mod command_code;
mod comments;
pub mod compare;
pub mod desk;
pub mod duration;
pub mod gpre;
pub mod input;
pub mod job;
pub mod layer_lines;
pub mod method_comparison;
pub mod output;
#[cfg(unix)]
pub mod page_host;
pub mod record;
pub mod remarks;
pub mod report;
pub mod schedule;
#[cfg(unix)]
pub mod serve;
pub mod session;
#[cfg(unix)]
pub mod settings_file;
pub mod show;
pub mod simulation;
pub mod sweep;
pub mod terminal;
mod version;
pub mod watch;

pub use version::VERSION;
