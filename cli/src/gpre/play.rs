//! Prints a prepared job.

use std::io::{self, Read};

use ferrostep_gpre::compact::{Decoder, Frame, HEAD_BYTES, frame_length};
use ferrostep_gpre::header::{FIXED_BYTES, HeaderCheck};
use ferrostep_gpre::{Encoding, Fault, Header, Item, ReadError};
use ferrostep_planner::PLANNER_VERSION;
use ferrostep_printer::{CommandError, Profile, Replies};

use crate::job::{JobError, JobProgress};
use crate::record::Observer;
use crate::session::DeskPrinter;

/// Reads a prepared job's parts one after the other and knows where it is.
pub struct PartReader<R> {
    input: R,
    /// Bytes read so far.
    offset: u64,
    bytes: Vec<u8>,
    next: u32,
}

impl<R: Read> PartReader<R> {
    /// From a file's start.
    pub fn new(input: R) -> Self {
        Self { input, offset: 0, bytes: Vec::new(), next: 0 }
    }

    /// Fills `bytes` from `from` on up to a length; says how many are there.
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

    /// The next frame and where it begins; `None` behind the last of `frames`.
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
}

/// A file that cannot be read on.
pub fn refused(error: ReadError) -> JobError {
    JobError::Prepared { frame: error.frame, line: None, offset: error.offset, message: error.fault.to_string() }
}

/// Executes a prepared job and waits for the end of its motion.
///
/// What is wrong with it ends it: what was taken before is executed, to a standstill on the path.
///
/// # Errors
/// As a [`ReadError`] or a [`CommandError`] has it, with the frame and its place.
pub async fn play<O: Observer, R: Replies>(
    input: &mut impl Read,
    profile: &Profile,
    printer: &mut DeskPrinter<'_, O, R>,
    progress: &mut JobProgress,
    mut look: impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    let mut reader = PartReader::new(input);
    let header = reader.header()?;
    header.matches(profile.hash(), PLANNER_VERSION).map_err(refused)?;
    if header.encoding == Encoding::Wide {
        let message = "the wide encoding cannot be printed yet, expected the compact one".to_owned();
        return Err(JobError::Prepared { frame: None, line: None, offset: 10, message });
    }
    progress.layers = header.layers;
    let mut outcome = Ok(());
    loop {
        match reader.frame(header.frames) {
            Ok(Some((frame, offset))) => {
                let number = frame.number;
                let result = match frame.items() {
                    Ok(mut items) => execute(&mut items, printer, progress).await,
                    Err(fault) => Err(Stopped { line: None, message: fault.to_string() }),
                };
                if let Err(Stopped { line, message }) = result {
                    outcome = Err(JobError::Prepared { frame: Some(number), line, offset, message });
                    break;
                }
            }
            Ok(None) => break,
            Err(error) => {
                outcome = Err(error);
                break;
            }
        }
        look(progress);
    }
    let finished = match outcome {
        Ok(()) => printer.finish().await,
        Err(_) => printer.abandon_prepared().await,
    };
    outcome?;
    finished.map_err(JobError::Stopped)
}

/// Why a frame was not executed to its end.
struct Stopped {
    line: Option<u32>,
    message: String,
}

impl From<Fault> for Stopped {
    fn from(fault: Fault) -> Self {
        Self { line: None, message: fault.to_string() }
    }
}

/// Executes the items of a frame.
async fn execute<O: Observer, R: Replies>(
    items: &mut Decoder<'_>,
    printer: &mut DeskPrinter<'_, O, R>,
    progress: &mut JobProgress,
) -> Result<(), Stopped> {
    let start = *items.start();
    let mut begun = false;
    let at = |line: u32| move |error: CommandError| Stopped { line: Some(line), message: error.to_string() };
    while let Some(item) = items.next_item()? {
        match item {
            Item::Move(next) => {
                progress.lines = next.line;
                if !begun && printer.machine_10nm() != start.position_10nm {
                    let message = "the frame begins elsewhere, expected it where the one before ended".to_owned();
                    return Err(Stopped { line: Some(next.line), message });
                }
                begun = true;
                printer.prepared_move(&next, &start.modal).await.map_err(at(next.line))?;
            }
            Item::Fan { line, power } => {
                progress.lines = line;
                printer.prepared_fan(line, power).await.map_err(at(line))?;
            }
            Item::Command { line, text } => {
                progress.lines = line;
                let stopped = |failure: ferrostep_printer::Failure| Stopped {
                    line: Some(line),
                    message: format!("{text:?}: {failure}"),
                };
                printer.execute(line, text).await.map_err(stopped)?;
            }
        }
    }
    Ok(())
}
