//! Input: lines from packets.

use ferrostep_gcode::meatpack::Unpacker;
use ferrostep_gcode::{Emergency, EmergencyScanner, Line, LineError, LineReader};

use crate::buffers::Buffers;

/// Marks where a line was broken off, in the ring of received bytes. No byte of UTF-8 has this
/// value.
pub const BREAK: u8 = 0xff;

/// Replacement for a host's own 0xff: not a byte of UTF-8 either, so its line is still rejected.
const NOT_A_BREAK: u8 = 0xfe;

/// Receiving end: passes bytes to the ring, unpacked if the host packs them (MeatPack), in whole
/// lines only, and picks out the commands that do not wait their turn.
///
/// While packing is on, M112 in plain text still stops the printer: a person may type it, or
/// another host that does not know of the packing. In packed text those bytes would be a second G
/// amid a line's numbers, which no command has.
#[derive(Clone, Debug, Default)]
pub struct Incoming {
    unpacker: Unpacker,
    /// Scans packed bytes as if they were plain.
    plain_scanner: EmergencyScanner,
    scanner: EmergencyScanner,
    /// The ring ends with an unfinished line.
    mid_line: bool,
    /// True if the unfinished line is broken off: a [`BREAK`] goes before the next byte.
    broken: bool,
    /// The rest of a line is being dropped, because it did not fit.
    dropping: bool,
    line: LineKind,
}

/// Kind of the line so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum LineKind {
    /// Empty.
    #[default]
    Empty,
    /// Printable ASCII.
    Text,
    /// A frame, or noise.
    Other,
}

impl Incoming {
    /// Receiver at the start of a line.
    pub const fn new() -> Self {
        Self {
            unpacker: Unpacker::new(),
            plain_scanner: EmergencyScanner::new(),
            scanner: EmergencyScanner::new(),
            mid_line: false,
            broken: false,
            dropping: false,
            line: LineKind::Empty,
        }
    }

    /// Takes a packet. Returns the number of bytes dropped for lack of room; if a line did not fit,
    /// its part in the ring is broken off as well.
    pub fn take_in(&mut self, packet: &[u8], buffers: &mut impl Buffers) -> u32 {
        let mut dropped = 0;
        for &received in packet {
            if self.unpacker.settings().packing {
                let emergency = self.plain_scanner.feed(received);
                emergency.filter(|emergency| *emergency == Emergency::Stop).inspect(|stop| buffers.emergency(*stop));
            }
            let unpacked = self.unpacker.feed(received);
            if let Some(settings) = unpacked.report {
                self.plain_scanner = EmergencyScanner::new();
                buffers.report_packing(settings);
            }
            for &byte in unpacked.bytes() {
                // No more than the packet's bytes and those packed in them.
                dropped = u32::wrapping_add(dropped, self.take_in_byte(byte, buffers).into());
            }
        }
        dropped
    }

    /// Takes a byte of text; returns true if it was dropped.
    fn take_in_byte(&mut self, byte: u8, buffers: &mut impl Buffers) -> bool {
        if let Some(emergency) = self.scanner.feed(byte) {
            buffers.emergency(emergency);
        }
        let ends_line = matches!(byte, b'\n' | b'\r');
        match byte {
            _ if ends_line => {
                if core::mem::take(&mut self.line) == LineKind::Text {
                    buffers.note_line();
                }
            }
            b' '..=b'~' | b'\t' if self.line != LineKind::Other => self.line = LineKind::Text,
            _ => self.line = LineKind::Other,
        }
        if !self.dropping {
            if self.broken {
                self.broken = !buffers.put(BREAK);
            }
            if !self.broken && buffers.put(if byte == BREAK { NOT_A_BREAK } else { byte }) {
                self.mid_line = !ends_line;
                return false;
            }
            self.broken |= self.mid_line;
            self.mid_line = false;
        }
        self.dropping = !ends_line;
        true
    }

    /// Notes that the connection has ended: the next bytes begin another line, and are plain until
    /// their host switches packing on.
    pub fn break_off(&mut self) {
        self.unpacker = Unpacker::new();
        self.plain_scanner = EmergencyScanner::new();
        self.scanner = EmergencyScanner::new();
        self.broken |= self.mid_line;
        self.mid_line = false;
        self.dropping = false;
        self.line = LineKind::Empty;
    }
}

/// Input from a host.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard<'a> {
    /// A line, or the reason why it cannot be read.
    Line(Result<Line<'a>, LineError>),
    /// Beginning of a line whose rest was lost with the connection or for lack of room; it is
    /// dropped. Always [`LineError::Incomplete`], which says whether the line began with a line
    /// number.
    HalfALine(LineError),
}

/// Reading end: turns bytes of the ring into lines.
#[derive(Clone, Debug, Default)]
pub struct Lines {
    reader: LineReader,
}

impl Lines {
    /// Reader at the start of line 1.
    pub const fn new() -> Self {
        Self { reader: LineReader::new() }
    }

    /// Reads up to the end of the next non-empty line, or to a break; see [`LineReader::feed`].
    pub fn feed<'a>(&'a mut self, bytes: &'a [u8]) -> (usize, Option<Heard<'a>>) {
        if bytes.first() == Some(&BREAK) {
            return (1, Some(Heard::HalfALine(self.reader.break_off())));
        }
        let length = bytes.iter().position(|&byte| byte == BREAK).unwrap_or(bytes.len());
        let (used, line) = self.reader.feed(bytes.get(..length).unwrap_or_default());
        (used, line.map(Heard::Line))
    }
}

#[cfg(test)]
mod tests {
    use ferrostep_gcode::Emergency;

    use super::*;

    /// Counts lines.
    struct Counter(u32);

    impl Buffers for Counter {
        fn put(&mut self, _: u8) -> bool {
            false
        }
        fn take(&mut self) -> Option<u8> {
            None
        }
        fn emergency(&mut self, _: Emergency) {}
        fn note_line(&mut self) {
            self.0 += 1;
        }
    }

    #[test]
    fn lines_are_noted_even_without_room_for_them() {
        for (bytes, lines) in [
            (&b"M105\n"[..], 1),
            (b"M105\r\nN3 G1 X5*44\n\n;\thm\r", 3),
            (b"M105", 0),
            (b"\n\r\n", 0),
            // A frame, noise, and text after it in the same line.
            (b"\x7e\x00abc\n", 0),
            (b"\xffM105\n\x00\n", 0),
            (b"\xff\nM105\n", 1),
            // Packed text, after a command that is not part of a line.
            (b"\xff\xff\xfbM105\n", 0),
            (b"M1\xff\xff\xf905\n\xff\xff\xfb\x1f\x4d\x50\xcc", 2),
        ] {
            let (mut incoming, mut counter) = (Incoming::new(), Counter(0));
            for &byte in bytes {
                incoming.take_in(&[byte], &mut counter);
            }
            assert_eq!(counter.0, lines, "{bytes:?}");
            // The rest of a line after the end of a connection belongs to another host.
            incoming.break_off();
            incoming.take_in(b"\n", &mut counter);
            assert_eq!(counter.0, lines);
        }
    }
}
