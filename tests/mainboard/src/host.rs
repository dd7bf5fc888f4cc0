//! The computer at the other end of the board's line.
//!
//! [`Stream`] is a host that prints a file by the `ok` protocol; it is independent of transport and
//! clock. [`Line`] opens a pseudo-terminal or TCP port for an external host program, such as
//! OctoPrint. [`usb`] is the computer's end of a USB cable.

mod stream;
pub mod usb;

pub use ferrostep_host_line::Line;
pub use stream::{Heard, LineKind, Options, Problem, Stream};
