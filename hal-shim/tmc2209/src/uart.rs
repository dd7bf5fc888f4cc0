//! The trait of the serial line to the drivers, and its buffers.

/// A datagram is still being sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineBusy;

/// Serial lines of one wire each, one of them in use at a time: 8 bits, no parity, one stop
/// bit, lowest bit first. On one wire the sender hears itself, so that sent bytes come back
/// before any reply.
///
/// No call waits. `now_ticks` is the clock of the caller, modulo 2^32; hardware
/// need not look at it.
pub trait SingleWireUart {
    /// Begins to send at most eight bytes on a line, and forgets earlier received bytes.
    ///
    /// # Errors
    /// A datagram is still being sent; the new one was not begun.
    fn send(&mut self, line: u8, bytes: &[u8], now_ticks: u32) -> Result<(), LineBusy>;

    /// The next byte that has been received whole, the echo included.
    fn receive(&mut self, now_ticks: u32) -> Option<u8>;
}

/// Maximum number of bytes of a datagram.
const SENT: usize = 8;

/// Received bytes that are kept: those of a read and its reply, and a margin.
const RECEIVED: usize = 16;

/// The buffers of a line: the bytes of a datagram to send, and those received.
#[derive(Clone, Copy, Debug, Default)]
pub struct LineBytes {
    to_send: [u8; SENT],
    length: usize,
    sent: usize,
    /// A ring, where it begins and how much it holds.
    received: [u8; RECEIVED],
    first: usize,
    waiting: usize,
}

impl LineBytes {
    /// No bytes.
    #[must_use]
    pub const fn new() -> Self {
        Self { to_send: [0; SENT], length: 0, sent: 0, received: [0; RECEIVED], first: 0, waiting: 0 }
    }

    /// Begins with a datagram, at most its first eight bytes, and forgets everything else.
    pub fn begin(&mut self, bytes: &[u8]) {
        *self = Self::new();
        for (to, from) in self.to_send.iter_mut().zip(bytes) {
            *to = *from;
            self.length += 1;
        }
    }

    /// Returns true if there are bytes to send.
    #[must_use]
    pub const fn has_more(&self) -> bool {
        self.sent < self.length
    }

    /// The byte to send, which stays.
    #[must_use]
    pub fn to_send(&self) -> Option<u8> {
        if self.has_more() { self.to_send.get(self.sent).copied() } else { None }
    }

    /// Removes the byte to send: it has been sent, or the transmitter has it.
    pub fn has_sent(&mut self) {
        self.sent = self.length.min(self.sent + 1);
    }

    /// Keeps a received byte; a byte too many is lost, and the checksum shows it.
    pub fn keep(&mut self, byte: u8) {
        if let Some(place) = self.received.get_mut((self.first + self.waiting) % RECEIVED)
            && self.waiting < RECEIVED
        {
            *place = byte;
            self.waiting += 1;
        }
    }

    /// Takes the first of the received bytes.
    pub fn take(&mut self) -> Option<u8> {
        self.waiting = self.waiting.checked_sub(1)?;
        let byte = self.received.get(self.first).copied();
        self.first = (self.first + 1) % RECEIVED;
        byte
    }
}
