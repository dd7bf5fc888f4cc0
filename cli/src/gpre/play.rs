//! Prints a prepared job.

use std::io::{self, Read};

use ferrostep_gpre::compact::{Decoder, Frame, HEAD_BYTES, frame_length};
use ferrostep_gpre::header::{FIXED_BYTES, HeaderCheck};
use ferrostep_gpre::wide::Packet;
use ferrostep_gpre::{Encoding, Fault, Header, Item, ReadError};
use ferrostep_planner::PLANNER_VERSION;
use ferrostep_printer::packets::{Asked, PacketReader, Place};
use ferrostep_printer::{CommandError, Failure, Ports, Printer, Profile};

use super::entry::{self, Passed};
use crate::job::{JobError, JobProgress};

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
}

impl<R: Read> PartReader<R> {
    /// The next packet of the wide encoding, its number and where it begins; `None` after the last of `packets`.
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
pub async fn play<P: Ports>(
    input: &mut impl Read,
    profile: &Profile,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    look: impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    play_from(0, input, profile, printer, progress, look).await
}

/// As [`play`], from a frame on, to whose start the machine is brought. Frame 0 is the job's start, which needs nothing of that.
///
/// # Errors
/// As [`play`], and [`JobError::Entry`] where there is no such frame, the job cannot be entered there, or the machine not be brought
/// there.
pub async fn play_from<P: Ports>(
    from: u32,
    input: &mut impl Read,
    profile: &Profile,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    mut look: impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    let mut reader = PartReader::new(input);
    let header = reader.header()?;
    header.matches(profile.plan_hash, PLANNER_VERSION).map_err(refused)?;
    progress.layers = header.layers;
    if from >= header.frames.max(1) {
        return Err(entry::no_such_frame(from, header.frames));
    }
    let outcome = match header.encoding {
        Encoding::Compact => {
            let job = Frames { count: header.frames, from, profile };
            frames(&mut reader, &job, printer, progress, &mut look).await
        }
        Encoding::Wide if from > 0 => return Err(entry::no_frames(from)),
        Encoding::Wide => packets(&mut reader, header.frames, printer, progress, &mut look).await,
    };
    if let Err(error) = outcome {
        // What stopped the job has been reported; a halt besides is known already.
        let _ = printer.abandon_prepared().await;
        return Err(error);
    }
    let Err(error) = printer.finish().await else { return Ok(()) };
    let _ = printer.abandon_prepared().await;
    Err(match error {
        CommandError::Plan(_) => {
            let (frame, line) = (header.frames.checked_sub(1), Some(progress.lines));
            JobError::Prepared { frame, line, offset: reader.offset, message: error.to_string() }
        }
        error => JobError::Stopped(error),
    })
}

/// Frames to be executed.
struct Frames<'a> {
    /// How many the file has.
    count: u32,
    /// The first.
    from: u32,
    profile: &'a Profile,
}

/// Executes all frames.
async fn frames<P: Ports>(
    reader: &mut PartReader<&mut impl Read>,
    job: &Frames<'_>,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    look: &mut impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    let Frames { count, from, profile } = *job;
    let mut passed = Passed::default();
    while let Some((frame, offset)) = reader.frame(count)? {
        let number = frame.number;
        let result = match frame.items() {
            Ok(mut items) if number < from => passed.pass(&mut items).map_err(Stopped::from),
            Ok(items) if from > 0 && number == from && !items.start().can_be_entered => {
                return Err(entry::not_here(number, reader, count));
            }
            Ok(mut items) => {
                if from > 0 && number == from {
                    entry::approach(items.start(), number, &passed, profile, printer).await?;
                }
                execute(&mut items, printer, progress).await
            }
            Err(fault) => Err(fault.into()),
        };
        result.map_err(|stopped| stopped.at(number, offset))?;
        look(progress);
    }
    Ok(())
}

/// Executes all packets.
async fn packets<P: Ports>(
    reader: &mut PartReader<&mut impl Read>,
    count: u32,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    look: &mut impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    let mut together = PacketReader::default();
    while let Some((packet, number, offset)) = reader.packet(count)? {
        let result = match together.take(&packet) {
            Ok(Some(asked)) => execute_asked(asked, printer, progress).await,
            Ok(None) => Ok(()),
            Err(expected) => Err(Fault::Content(expected).into()),
        };
        result.map_err(|stopped| stopped.at(number, offset))?;
        if number % 1024 == 0 {
            look(progress);
        }
    }
    if together.is_complete() {
        return Ok(());
    }
    Err(refused(ReadError { fault: Fault::Truncated, offset: reader.offset, frame: None }))
}

/// Executes what packets ask for.
async fn execute_asked<P: Ports>(
    asked: Asked<'_>,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
) -> Result<(), Stopped> {
    let at = |line: u32| move |error: CommandError| Stopped { line: Some(line), message: error.to_string() };
    match asked {
        Asked::Block(block, moves) => {
            progress.lines = block.block.line;
            printer.prepared_block(&block, moves).await.map_err(at(block.block.line))
        }
        Asked::Fan { line, power } => printer.prepared_fan(line, power).await.map_err(at(line)),
        Asked::Place(Place { position_10nm, lift_10nm, extruder_10nm }) => {
            printer.prepared_place(position_10nm, lift_10nm, extruder_10nm).map_err(at(progress.lines))
        }
        Asked::Command { line, text } => {
            progress.lines = line;
            let text = std::str::from_utf8(text).map_err(|_| Fault::Content("a command of UTF-8"))?;
            printer.execute(line, text).await.map_err(|failure| Stopped::at_command(line, text, &failure))
        }
    }
}

/// Why a frame was not executed to its end.
struct Stopped {
    line: Option<u32>,
    message: String,
}

impl Stopped {
    fn at(self, frame: u32, offset: u64) -> JobError {
        JobError::Prepared { frame: Some(frame), line: self.line, offset, message: self.message }
    }

    fn at_command(line: u32, text: &str, failure: &Failure) -> Self {
        Self { line: Some(line), message: format!("{text:?}: {failure}") }
    }
}

impl From<Fault> for Stopped {
    fn from(fault: Fault) -> Self {
        Self { line: None, message: fault.to_string() }
    }
}

/// Executes the items of a frame.
async fn execute<P: Ports>(
    items: &mut Decoder<'_>,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
) -> Result<(), Stopped> {
    let start = *items.start();
    let mut begun = false;
    let at = |line: u32| move |error: CommandError| Stopped { line: Some(line), message: error.to_string() };
    while let Some(item) = items.next_item()? {
        match item {
            Item::Move(next) => {
                progress.lines = next.line;
                // Where M290 has shifted Z, that is what is wrong.
                if !begun && printer.machine_10nm() != start.position_10nm && !printer.is_shifted() {
                    let message = "the frame begins elsewhere, expected it where the one before ended".to_owned();
                    return Err(Stopped { line: Some(next.line), message });
                }
                begun = true;
                printer.prepared_move(next, &start.modal).await.map_err(at(next.line))?;
            }
            Item::Fan { line, power } => {
                progress.lines = line;
                printer.prepared_fan(line, power).await.map_err(at(line))?;
            }
            Item::Command { line, text } => {
                progress.lines = line;
                printer.execute(line, text).await.map_err(|failure| Stopped::at_command(line, text, &failure))?;
            }
        }
    }
    Ok(())
}
