//! Reads a prepared job part by part.

use std::io::{self, Read};

use ferrostep_gpre::compact::{Frame, HEAD_BYTES, frame_length};
use ferrostep_gpre::header::{FIXED_BYTES, HeaderCheck};
use ferrostep_gpre::{Fault, Header, ReadError};
use ferrostep_papers::wide::Packet;

use crate::job::JobError;

/// Reads a prepared job's parts one after the other, and keeps their places.
pub struct PartReader<R> {
    input: R,
    /// Bytes read so far.
    offset: u64,
    bytes: Vec<u8>,
    next: u32,
}

impl<R: Read> PartReader<R> {
    /// Reads from a file's start.
    pub fn new(input: R) -> Self {
        Self { input, offset: 0, bytes: Vec::new(), next: 0 }
    }

    /// Fills `bytes` from `from` on up to a length. Returns how many bytes it then has.
    fn fill(&mut self, from: usize, length: usize) -> Result<usize, JobError> {
        self.bytes.resize(length, 0);
        let mut at = from;
        while at < length {
            match self.input.read(&mut self.bytes[at..]) {
                Ok(0) => break,
                Ok(read) => at += read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(JobError::Read { line: 0, error }),
            }
        }
        Ok(at)
    }

    /// Byte of the file at which the next part begins.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// The header, checked to its last byte.
    pub fn header(&mut self) -> Result<Header, JobError> {
        let truncated = |at: usize| refused(ReadError { fault: Fault::Truncated, offset: at as u64, frame: None });
        let read = self.fill(0, FIXED_BYTES)?;
        let header = Header::read(&self.bytes[..read]).map_err(refused)?;
        let length = header.length() as usize;
        let read = self.fill(FIXED_BYTES, length)?;
        if read < length {
            return Err(truncated(read));
        }
        let (before, sum) = self.bytes.split_last_chunk::<4>().ok_or_else(|| truncated(read))?;
        let mut check = HeaderCheck::new();
        check.pass(before);
        check.end(*sum).map_err(refused)?;
        self.offset = length as u64;
        Ok(header)
    }

    /// The next frame and where it begins; `None` after the last of `frames`.
    pub fn frame(&mut self, frames: u32) -> Result<Option<(Frame<'_>, u64)>, JobError> {
        let offset = self.offset;
        let fault = |fault, offset, frame| refused(ReadError { fault, offset, frame: Some(frame) });
        let read = self.fill(0, HEAD_BYTES)?;
        if read == 0 && self.next == frames {
            return Ok(None);
        }
        if self.next == frames {
            return Err(refused(ReadError { fault: Fault::Trailing, offset, frame: None }));
        }
        let head = self.bytes.first_chunk::<HEAD_BYTES>().filter(|_| read == HEAD_BYTES);
        let Some(head) = head else {
            return Err(fault(Fault::Truncated, offset + read as u64, self.next));
        };
        let length = frame_length(head).map_err(|wrong| fault(wrong, offset, self.next))?;
        let read = self.fill(HEAD_BYTES, length)?;
        if read < length {
            return Err(fault(Fault::Truncated, offset + read as u64, self.next));
        }
        self.offset += length as u64;
        let expected = self.next;
        self.next += 1;
        let frame = Frame::read(&self.bytes, offset, Some(expected)).map_err(refused)?;
        Ok(Some((frame, offset)))
    }

    /// The next packet of the wide encoding, its number and where it begins; `None` after the
    /// last of `packets`.
    pub fn packet(&mut self, packets: u32) -> Result<Option<(Packet, u32, u64)>, JobError> {
        let (offset, number) = (self.offset, self.next);
        let fault = |fault| refused(ReadError { fault, offset, frame: Some(number) });
        let read = self.fill(0, 4)?;
        if number == packets {
            let trailing = ReadError { fault: Fault::Trailing, offset, frame: None };
            return if read == 0 { Ok(None) } else { Err(refused(trailing)) };
        }
        let truncated = |read: usize| {
            refused(ReadError { fault: Fault::Truncated, offset: offset + read as u64, frame: Some(number) })
        };
        let start = *self.bytes.first_chunk::<4>().filter(|_| read == 4).ok_or_else(|| truncated(read))?;
        let length = Packet::length(start).map_err(fault)?;
        let read = self.fill(4, length)?;
        if read < length {
            return Err(truncated(read));
        }
        self.offset += length as u64;
        self.next += 1;
        Packet::read(&self.bytes).map(|packet| Some((packet, number, offset))).map_err(fault)
    }
}

/// The error for a file that cannot be read further.
pub fn refused(error: ReadError) -> JobError {
    JobError::Prepared { frame: error.frame, line: None, offset: error.offset, message: error.fault.to_string() }
}
