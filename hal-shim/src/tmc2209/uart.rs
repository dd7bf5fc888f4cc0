//! The line to the drivers, whoever makes it.

/// A datagram is still being sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineBusy;

/// Serial lines of one wire each, of which one is in use at a time: 8 bits, no parity, one stop bit, lowest bit first. On
/// one wire the sender hears itself, so that what was sent comes back before any reply.
///
/// No call waits. `now_ticks` is the clock of the caller, modulo 2^32; hardware need not look at it.
pub trait SingleWireUart {
    /// Begins to send at most eight bytes on a line, and forgets what was received before.
    ///
    /// # Errors
    /// Something is still being sent; nothing was begun.
    fn send(&mut self, line: u8, bytes: &[u8], now_ticks: u32) -> Result<(), LineBusy>;

    /// The next byte that has been received whole, the echo included.
    fn receive(&mut self, now_ticks: u32) -> Option<u8>;
}
