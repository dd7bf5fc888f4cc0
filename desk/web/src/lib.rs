//! Web page that shows a printer and controls it, and the HTTP server for the page.
//!
//! The server accesses the printer through the [`Printer`] trait. A client without the token gets
//! only the page, which is the same for every printer. No path of a request becomes the path of a
//! file.

mod answer;
mod console;
mod control;
mod deadline;
mod form;
mod guard;
mod page;
mod printer;
mod request;
mod routes;
mod server;
mod slicer;
mod upload;

pub use console::{Console, ConsoleLine, Speaker};
pub use control::{Axis, Control};
pub use guard::Token;
pub use printer::{Activity, Heat, Job, Printer, Refusal, State, Upload};
pub use server::{Limits, Server};

/// Returns true if a request's head is complete before the input ends, for the fuzz target.
///
/// # Errors
/// The status that answers input which is not a request.
#[doc(hidden)]
pub fn reads_head(input: &mut impl std::io::Read) -> Result<bool, u16> {
    request::Request::read(input).map(|request| request.is_some()).map_err(|answer| answer.status)
}
