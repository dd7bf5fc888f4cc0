//! Frames on the wire.

use super::frame::{CRC_BYTES, ESCAPE, FLAG, HEAD_BYTES, Kind};
use crate::checksum::CRC;

/// A frame that has arrived whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Arrived {
    pub(super) kind: Kind,
    pub(super) place: u32,
    /// Length of the data in bytes; the buffer holds as many of them as fit.
    pub(super) length: usize,
}

/// Meaning of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Taken {
    /// Part of a frame.
    Frame,
    /// End of a whole frame.
    Whole(Arrived),
    /// End of a frame that is malformed or was changed in transit.
    Broken,
    /// The byte is not part of a frame.
    Other,
}

/// Takes frames apart, byte by byte.
pub(super) struct Unwrap {
    in_frame: bool,
    escaped: bool,
    head: [u8; HEAD_BYTES],
    /// The last bytes, the newest in the lowest place.
    last: u32,
    /// Bytes since the flag.
    count: usize,
    digest: crc::Digest<'static, u32, crc::Table<1>>,
}

impl Unwrap {
    pub(super) fn new() -> Self {
        Self { in_frame: false, escaped: false, head: [0; HEAD_BYTES], last: 0, count: 0, digest: CRC.digest() }
    }

    /// True if a frame has begun and not ended.
    pub(super) fn is_in_frame(&self) -> bool {
        self.in_frame
    }

    /// Discards any partial frame.
    pub(super) fn reset(&mut self) {
        *self = Self::new();
    }

    /// Takes a byte. Data goes to `room` as it arrives, before the frame's checksum is checked.
    pub(super) fn take(&mut self, byte: u8, room: &mut [u8]) -> Taken {
        if byte == FLAG {
            self.reset();
            self.in_frame = true;
            return Taken::Frame;
        }
        if !self.in_frame {
            return Taken::Other;
        }
        match byte {
            b'\n' | b'\r' => {
                let end = self.end();
                self.reset();
                end.map_or(Taken::Broken, Taken::Whole)
            }
            ESCAPE => {
                self.escaped = true;
                Taken::Frame
            }
            _ => {
                let byte = if core::mem::take(&mut self.escaped) { byte ^ 0x80 } else { byte };
                self.content(byte, room);
                Taken::Frame
            }
        }
    }

    fn length(&self) -> usize {
        let [.., length] = self.head;
        usize::from(length)
    }

    fn content(&mut self, byte: u8, room: &mut [u8]) {
        if let Some(place) = self.head.get_mut(self.count) {
            *place = byte;
            self.digest.update(&[byte]);
        } else if self.count < HEAD_BYTES + self.length() {
            if let Some(place) = room.get_mut(self.count - HEAD_BYTES) {
                *place = byte;
            }
            self.digest.update(&[byte]);
        } else {
            self.last = self.last >> 8 | u32::from(byte) << 24;
        }
        self.count = self.count.saturating_add(1);
    }

    fn end(&self) -> Option<Arrived> {
        let length = self.length();
        if self.count != HEAD_BYTES + length + CRC_BYTES || self.digest.clone().finalize() != self.last {
            return None;
        }
        let [kind, a, b, c, d, _] = self.head;
        let kind = Kind::ALL.into_iter().find(|known| known.number() == kind)?;
        Some(Arrived { kind, place: u32::from_le_bytes([a, b, c, d]), length })
    }
}

/// Frame as sent on the wire. At most [`super::MAX_DATA_BYTES`] of the data are taken.
#[cfg(feature = "write")]
pub fn to_wire(kind: Kind, place: u32, data: &[u8]) -> std::vec::Vec<u8> {
    let data = data.get(..super::frame::MAX_DATA_BYTES).unwrap_or(data);
    let mut content = std::vec::Vec::with_capacity(HEAD_BYTES + data.len() + CRC_BYTES);
    content.push(kind.number());
    content.extend_from_slice(&place.to_le_bytes());
    content.push(data.len() as u8);
    content.extend_from_slice(data);
    let sum = CRC.checksum(&content);
    content.extend_from_slice(&sum.to_le_bytes());
    let mut wire = std::vec::Vec::with_capacity(content.len() + 8);
    wire.push(FLAG);
    for byte in content {
        match byte {
            b'\n' | b'\r' | 0x11 | 0x13 | b'M' | b'm' | ESCAPE | FLAG | 0xff => wire.extend([ESCAPE, byte ^ 0x80]),
            _ => wire.push(byte),
        }
    }
    wire.push(b'\n');
    wire
}
