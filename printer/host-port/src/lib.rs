//! The host's serial port over USB: a CDC-ACM device (USB CDC 1.2, PSTN subclass) over any
//! controller that has a [`UsbBus`](usb_device::bus::UsbBus).
//!
//! It is a separate port beside the serial line: its bytes go to a separate ring, and its host has
//! its own line numbers and replies. A host may vanish at any moment, and may stop reading; neither
//! must stop the machine:
//!
//! - Unread output waits in a ring of fixed size. A line that does not fit is dropped whole, and
//!   counted ([`LineWriter`]).
//! - What the firmware does not read in time is dropped in whole lines, and counted ([`Incoming`]).
//!   The dropped bytes are still scanned for M112. Holding the host back instead would also hold
//!   back its M112.
//! - A serial line, which cannot be held back at all, uses the same rings and readers.
//! - If a connection ends within a line, that line is dropped and the next one begins afresh
//!   ([`BREAK`], [`Lines`]).
#![cfg_attr(not(test), no_std)]

mod buffers;
mod identity;
mod incoming;
mod line_writer;
mod outgoing;
mod port;

pub use buffers::Buffers;
pub use identity::{MANUFACTURER, PRODUCT_ID, SerialNumber, VENDOR_ID};
pub use incoming::{BREAK, Heard, Incoming, Lines};
pub use line_writer::LineWriter;
pub use outgoing::PACKET_BYTES;
pub use port::UsbSerial;
