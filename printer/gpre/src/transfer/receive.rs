//! The board's end: frames to bytes of the file, in their order.

use super::frame::{Kind, MAX_DATA_BYTES};
use super::report::{Report, Word};
use super::wire::{Taken, Unwrap};

/// Maximum lead of the host over the bytes it knows to have arrived. Encoded as frames, they fit
/// into the ring between a port's interrupt and its reader, so a late reader loses nothing.
const WINDOW_BYTES: u32 = 1024;

/// The effect of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The byte is not part of a frame.
    Other,
    /// The byte belongs to a frame that is not complete yet.
    Nothing,
    /// Number of new bytes at the start of the room.
    Bytes(usize),
    /// The host should be answered; no byte is new.
    Answer,
    /// The host gives up.
    Aborted,
}

/// Receives a file's frames.
///
/// ```
/// use ferrostep_gpre::transfer::{Event, Kind, Receiver, to_wire};
///
/// let mut receiver = Receiver::new(5);
/// let mut room = [0; 16];
/// let wire = to_wire(Kind::Data, 0, b"hello");
/// let events: Vec<_> = wire.into_iter().map(|byte| receiver.take(byte, &mut room)).collect();
/// assert_eq!(events.last(), Some(&Event::Bytes(5)));
/// assert_eq!(&room[..5], b"hello");
/// ```
pub struct Receiver {
    unwrap: Unwrap,
    size: u32,
    /// The first missing byte.
    next: u32,
    /// A missing byte was reported to the host, which has not sent it since.
    asked: bool,
}

impl Receiver {
    /// Receiver of a file of this length, before its first byte.
    pub fn new(size: u32) -> Self {
        Self { unwrap: Unwrap::new(), size, next: 0, asked: false }
    }

    /// Bytes of the file.
    pub fn size(&self) -> u32 {
        self.size
    }

    /// True if all bytes have arrived.
    pub fn is_complete(&self) -> bool {
        self.next == self.size
    }

    /// True if a frame has begun and not ended.
    pub fn is_in_frame(&self) -> bool {
        self.unwrap.is_in_frame()
    }

    /// Discards a started frame, because the line was interrupted.
    pub fn interrupt(&mut self) {
        self.unwrap.reset();
    }

    /// Takes a byte. `room` is where the file's next bytes belong; it may be written to before a
    /// frame is known to be valid.
    pub fn take(&mut self, byte: u8, room: &mut [u8]) -> Event {
        let arrived = match self.unwrap.take(byte, room) {
            Taken::Other => return Event::Other,
            Taken::Frame => return Event::Nothing,
            Taken::Broken => return self.ask(),
            Taken::Whole(arrived) => arrived,
        };
        match arrived.kind {
            Kind::Abort => Event::Aborted,
            Kind::Question => {
                // Every question is answered; the answer makes a host go back that believes it is
                // further ahead.
                self.asked = arrived.place > self.next;
                Event::Answer
            }
            Kind::Data if arrived.place == self.next => {
                let left = (self.size - self.next) as usize;
                if arrived.length == 0 || arrived.length > left || arrived.length > room.len() {
                    return self.ask();
                }
                self.asked = false;
                self.next += arrived.length as u32;
                Event::Bytes(arrived.length)
            }
            // A repeated frame: the answer to the first was lost.
            Kind::Data if arrived.place < self.next => Event::Answer,
            Kind::Data => self.ask(),
        }
    }

    /// Reports a missing byte once: frames sent in the meantime must not make the host go back
    /// again and again.
    fn ask(&mut self) -> Event {
        if core::mem::replace(&mut self.asked, true) { Event::Nothing } else { Event::Answer }
    }

    /// The report for the host, with this much room left for bytes to come.
    pub fn report(&self, room: usize) -> Report {
        let room = u32::try_from(room).unwrap_or(u32::MAX).min(WINDOW_BYTES);
        let limit = self.next.saturating_add(room).min(self.size);
        Report { word: if self.asked { Word::Again } else { Word::Have }, numbers: [self.next, limit] }
    }

    /// True if a host that knows `limit` should learn that there is more room by now.
    pub fn has_opened(&self, limit: u32, room: usize) -> bool {
        let now = self.report(room).numbers[1];
        limit < self.size && now > limit && (now == self.size || now - limit >= MAX_DATA_BYTES as u32)
    }
}
