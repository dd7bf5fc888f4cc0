//! A file that arrives in pieces: its header, then frame after frame.

use crate::compact::{HEAD_BYTES, frame_length};
use crate::error::{Fault, ReadError};
use crate::header::{FIXED_BYTES, Header, HeaderCheck};

/// The part of the file at the start of the received bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The bytes are too few to read anything.
    More,
    /// Number of bytes of the header, which the caller may drop.
    Passed(usize),
    /// The last bytes of the header, this many, and the header itself. Its checksum is right.
    Header(usize, Header),
    /// A whole frame, to be read by [`crate::compact::Frame::read`].
    Frame {
        /// Length of the part, bytes.
        length: usize,
        /// Expected number of the frame.
        number: u32,
        /// Offset of its start in the file.
        offset: u64,
    },
    /// The file ends here, as it should.
    End,
}

/// Finds the start of each part of a file.
pub struct Parts {
    offset: u64,
    header: Option<Header>,
    check: HeaderCheck,
    next: u32,
}

impl Parts {
    /// New at the file's first byte.
    pub fn new() -> Self {
        Self { offset: 0, header: None, check: HeaderCheck::new(), next: 0 }
    }

    /// Identifies the part at the start of `bytes`, which begin where the previous part ended.
    /// `complete`: no more bytes follow. A returned part counts as passed.
    ///
    /// # Errors
    /// A malformed part, or a file that ends too early.
    pub fn next(&mut self, bytes: &[u8], complete: bool) -> Result<Part, ReadError> {
        let part = self.look(bytes, complete)?;
        match part {
            Part::More | Part::End => {}
            Part::Passed(length) | Part::Header(length, _) => self.offset += length as u64,
            Part::Frame { length, .. } => {
                self.offset += length as u64;
                self.next += 1;
            }
        }
        Ok(part)
    }

    fn look(&mut self, bytes: &[u8], complete: bool) -> Result<Part, ReadError> {
        let Some(header) = self.header else {
            let Some(fixed) = bytes.get(..FIXED_BYTES) else {
                // Shorter than any header, and perhaps no header at all.
                return if complete { Header::read(bytes).map(|_| Part::More) } else { Ok(Part::More) };
            };
            self.header = Some(Header::read(fixed)?);
            self.check.pass(fixed);
            return Ok(Part::Passed(FIXED_BYTES));
        };
        let left = u64::from(header.length()).saturating_sub(self.offset);
        if left > 0 {
            return self.rest_of(header, bytes, left, complete);
        }
        let frame = Some(self.next);
        let fail = |fault, offset| Err(ReadError { fault, offset, frame });
        if self.next == header.frames {
            return match bytes {
                [] if complete => Ok(Part::End),
                [] => Ok(Part::More),
                _ => Err(ReadError { fault: Fault::Trailing, offset: self.offset, frame: None }),
            };
        }
        let more = || {
            let end = self.offset + bytes.len() as u64;
            if complete { fail(Fault::Truncated, end) } else { Ok(Part::More) }
        };
        let Some(head) = bytes.first_chunk::<HEAD_BYTES>() else { return more() };
        let length = frame_length(head).map_err(|fault| ReadError { fault, offset: self.offset, frame })?;
        if bytes.len() < length {
            return more();
        }
        Ok(Part::Frame { length, number: self.next, offset: self.offset })
    }

    /// The thumbnail and the checksum after it.
    fn rest_of(&mut self, header: Header, bytes: &[u8], left: u64, complete: bool) -> Result<Part, ReadError> {
        if let Some(sum) = bytes.first_chunk::<4>().filter(|_| left == 4) {
            core::mem::take(&mut self.check).end(*sum)?;
            return Ok(Part::Header(4, header));
        }
        let passed = usize::try_from(left - 4).unwrap_or(usize::MAX).min(bytes.len());
        if passed > 0 {
            self.check.pass(bytes.get(..passed).unwrap_or_default());
            return Ok(Part::Passed(passed));
        }
        if complete {
            let offset = self.offset + bytes.len() as u64;
            return Err(ReadError { fault: Fault::Truncated, offset, frame: None });
        }
        Ok(Part::More)
    }
}

impl Default for Parts {
    fn default() -> Self {
        Self::new()
    }
}
