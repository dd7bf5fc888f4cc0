//! Lines to the host, which may not be reading.

use core::fmt::{self, Write};

use heapless::spsc::Producer;

/// Writes whole lines to a ring, or drops them; never waits.
pub struct LineWriter<'a> {
    bytes: Producer<'a, u8>,
    dropped: u32,
}

impl<'a> LineWriter<'a> {
    /// Writes to a ring.
    pub const fn new(bytes: Producer<'a, u8>) -> Self {
        Self { bytes, dropped: 0 }
    }

    /// Adds a line of an answer, without its line end.
    pub fn reply(&mut self, text: fmt::Arguments<'_>) {
        self.line(text, 0);
    }

    /// Adds an unsolicited line. Half of the ring stays reserved for replies: a host that pauses
    /// its reading may miss reports, but never an `ok` that it waits for.
    pub fn report(&mut self, text: fmt::Arguments<'_>) {
        self.line(text, self.bytes.capacity() / 2);
    }

    /// True if half of the ring is free: room for a line that is to leave the other
    /// half to replies.
    pub fn is_half_free(&self) -> bool {
        self.bytes.len() <= self.bytes.capacity() / 2
    }

    fn line(&mut self, text: fmt::Arguments<'_>, reserve: usize) {
        let room = self.bytes.capacity().saturating_sub(self.bytes.len()).saturating_sub(reserve);
        let whole = format_args!("{text}\n");
        let dropped = self.dropped;
        if dropped == 0 {
            if !self.fits(whole, room) {
                self.dropped = 1;
            }
        } else if self.fits(format_args!("echo:usb: nobody read, {dropped} lines dropped\n{whole}"), room) {
            self.dropped = 0;
        } else {
            self.dropped = dropped.saturating_add(1);
        }
    }

    /// Writes a text if it fits.
    fn fits(&mut self, text: fmt::Arguments<'_>, room: usize) -> bool {
        let mut length = Length(0);
        // Both succeed: the room was checked before.
        let fits = length.write_fmt(text).is_ok() && length.0 <= room;
        fits && Ring(&mut self.bytes).write_fmt(text).is_ok()
    }
}

struct Length(usize);

impl Write for Length {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0 = self.0.saturating_add(text.len());
        Ok(())
    }
}

struct Ring<'a, 'b>(&'b mut Producer<'a, u8>);

impl Write for Ring<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.bytes().try_for_each(|byte| self.0.enqueue(byte).map_err(|_| fmt::Error))
    }
}
