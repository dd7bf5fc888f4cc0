//! The host's end: splits a file into frames, and repeats those that the board asks for.

use std::vec::Vec;

use super::frame::{Kind, MAX_DATA_BYTES};
use super::report::{Report, Word};
use super::wire::to_wire;
use crate::error::ReadError;
use crate::header::Header;

/// Bytes of data in a frame: enough that framing costs a tenth at most, few enough that a lost
/// frame costs little.
const DATA_BYTES: usize = 128;

const _: () = assert!(DATA_BYTES <= MAX_DATA_BYTES);

/// Sends a job: makes the frames to send and takes the board's answers; the caller moves the bytes
/// and keeps the time.
///
/// A caller that has sent everything and gets no answer for a while sends [`Sender::question`].
#[derive(Clone, Debug)]
pub struct Sender {
    job: Vec<u8>,
    /// The board has everything before this byte.
    arrived: usize,
    /// The next byte to send.
    next: usize,
    /// The first byte that must not be sent yet.
    limit: usize,
    /// Requests by the board to repeat something.
    repeats: u32,
    /// The board has reported that it is receiving.
    begun: bool,
    end: Option<Report>,
    frame_bytes: usize,
}

impl Sender {
    /// Sender of these bytes, which follow the command of [`Self::command`].
    pub fn new(job: Vec<u8>) -> Self {
        Self { job, arrived: 0, next: 0, limit: 0, repeats: 0, begun: false, end: None, frame_bytes: DATA_BYTES }
    }

    /// Puts this many bytes into a frame, from 1 to [`MAX_DATA_BYTES`]: fewer where many
    /// frames are lost.
    pub fn set_frame_bytes(&mut self, bytes: usize) {
        self.frame_bytes = bytes.clamp(1, MAX_DATA_BYTES);
    }

    /// The command that begins the transfer. `silence_s` is how long the board waits for a frame
    /// before it gives up, s.
    pub fn command(&self, silence_s: u16) -> std::string::String {
        std::format!("M790 S{} T{silence_s}", self.job.len())
    }

    /// Length of the job, bytes.
    pub fn size(&self) -> usize {
        self.job.len()
    }

    /// Bytes that the board has.
    pub fn arrived(&self) -> usize {
        self.arrived
    }

    /// Number of requests by the board to repeat something.
    pub fn repeats(&self) -> u32 {
        self.repeats
    }

    /// True once the board has said that it receives the job.
    pub fn has_begun(&self) -> bool {
        self.begun
    }

    /// True if the board has not confirmed everything that was sent.
    pub fn awaits_answer(&self) -> bool {
        self.next > self.arrived
    }

    /// Final report; `None` before the transfer ends.
    pub fn end(&self) -> Option<Report> {
        self.end
    }

    /// The next frame that may be sent now.
    pub fn next_frame(&mut self) -> Option<Vec<u8>> {
        if self.end.is_some() || self.next >= self.limit {
            return None;
        }
        let end = self.limit.min(self.next + self.frame_bytes);
        // Waits for more room rather than filling it with many small frames.
        if end < self.next + self.frame_bytes && end < self.job.len() && self.awaits_answer() {
            return None;
        }
        let frame = to_wire(Kind::Data, self.next as u32, self.job.get(self.next..end)?);
        self.next = end;
        Some(frame)
    }

    /// Asks the board which bytes it has; sent after some time without an answer.
    pub fn question(&self) -> Vec<u8> {
        to_wire(Kind::Question, self.next as u32, &[])
    }

    /// Tells the board to stop.
    pub fn abort(&self) -> Vec<u8> {
        to_wire(Kind::Abort, 0, &[])
    }

    /// Takes a line from the board; returns `true` if it is a report. Late or out-of-order reports
    /// do no harm.
    pub fn hear(&mut self, line: &str) -> bool {
        let Some(report) = Report::parse(line) else { return false };
        let [first, second] = report.numbers.map(|number| number as usize);
        match report.word {
            Word::Have | Word::Again => {
                self.begun = true;
                if first >= self.arrived && first <= self.job.len() {
                    self.arrived = first;
                    self.next = self.next.max(first);
                    self.limit = self.limit.max(second.min(self.job.len()));
                    if report.word == Word::Again {
                        self.repeats += 1;
                        self.next = first;
                    }
                }
            }
            // A report before the start is about another job.
            _ if !self.begun => {}
            Word::Done | Word::Refused | Word::Stopped | Word::None => self.end = Some(report),
        }
        true
    }
}

/// The job without the slicer's thumbnail, which a board cannot use.
///
/// # Errors
/// The bytes do not begin as a prepared job does.
pub fn without_thumbnail(job: Vec<u8>) -> Result<Vec<u8>, ReadError> {
    let header = Header::read(&job)?;
    if header.thumbnail.is_none() {
        return Ok(job);
    }
    let rest = job.get(header.length() as usize..).unwrap_or_default();
    let mut bare = Header { thumbnail: None, ..header }.to_bytes(&[]);
    bare.extend_from_slice(rest);
    Ok(bare)
}
