//! The desk's machine in virtual time, and the jobs that it executes: what reads them, what
//! observes them, and what they leave.

mod ahead;
pub mod black_box;
#[cfg(unix)]
pub mod card_image;
pub mod command_code;
mod comments;
pub mod desk;
pub mod duration;
pub mod extent;
pub mod gpre;
pub mod input;
pub mod job;
mod job_replies;
pub mod layer_lines;
pub mod limit_shares;
pub mod macros;
pub mod output;
#[cfg(unix)]
pub mod page_host;
pub mod parts;
pub mod record;
pub mod remarks;
pub mod report;
pub mod rules;
pub mod schedule;
#[cfg(unix)]
pub mod serve;
mod session;
#[cfg(unix)]
pub mod settings_file;
pub mod summed_up;
pub mod took;
pub mod unread;
mod version;
pub mod watch;

pub use job_replies::JobReplies;
pub use session::{DeskPorts, DeskPrinter, LiveSession, PlanSession, PrintSession, Session};
pub use version::VERSION;
