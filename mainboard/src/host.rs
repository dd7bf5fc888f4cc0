//! Who sits at the other end of the board's line.
//!
//! [`Stream`] is a host of its own, which prints a file by the `ok` protocol; it knows no transport and no clock. [`Line`] is
//! a door for somebody else's host, such as OctoPrint: a pseudo-terminal or a TCP port of this computer. [`usb`] is the
//! computer's end of a USB cable.

mod line;
mod stream;
pub mod usb;

pub use line::Line;
pub use stream::{Answer, Heard, Options, Problem, Stream};
