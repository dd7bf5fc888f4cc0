//! Converts G-code to GPRE in one pass and in constant memory.

use std::io::{self, Read, Seek, SeekFrom, Write};

use ferrostep_gcode::{BedCommand, Command, Decimal, parse};
use ferrostep_gpre::compact::FrameWriter;
use ferrostep_gpre::{Encoding, Header, ModalState, Thumbnail};
use ferrostep_papers::wide::PacketWriter;
use ferrostep_planner::{AccelerationProfile, PLANNER_VERSION};
use ferrostep_printer::{Ports, Printer, Profile, Tally};

use super::script::{Ready, Script};
use crate::desk::{Figures, PlanReader};
use crate::job::{self, JobError, JobProgress, Onlooker};
use crate::job_replies::JobReplies;
use crate::macros::Macros;
use crate::remarks::Remark;
use crate::session::Session;
use crate::watch::Watch;

/// Blocks in the look-ahead ring while a job is prepared: longer than any stopping distance.
pub const LOOK_AHEAD_BLOCKS: usize = 65_536;

/// Bytes that are kept before they are written.
const PORTION_BYTES: usize = 64 * 1024;

/// The target of a prepared job.
#[derive(Debug)]
pub struct Target<W> {
    /// The file.
    pub out: W,
    /// Encoding of the file.
    pub encoding: Encoding,
}

/// A prepared job, and how it came about.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// The header of the file.
    pub header: Header,
    /// Length of the file, bytes.
    pub bytes: u64,
    /// Bytes of all frames (packets): the header and its thumbnail left out.
    pub content_bytes: u64,
    /// Length of the G-code, bytes.
    pub source_bytes: u64,
    /// Progress of reading the G-code.
    pub progress: JobProgress,
    /// Counts of its work.
    pub tally: Tally,
    /// Remarks for a person.
    pub remarks: Vec<Remark>,
}

/// Reason for which a job was not prepared, or only in part.
#[derive(Debug)]
pub enum PrepareError {
    /// The machine's acceleration profile cannot be prepared.
    Acceleration(AccelerationProfile),
    /// The profile lets filament move along travels, and a prepared job has a stop for it.
    FilamentOnTheWay,
    /// The G-code cannot be executed.
    Job(JobError),
    /// The file cannot be written.
    Write(io::Error),
    /// A command cannot be written to a prepared job: its line, and the reason.
    Command(u32, &'static str),
}

impl std::fmt::Display for PrepareError {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Acceleration(acceleration) => write!(
                out,
                "acceleration = \"{}\": prepared jobs have trapezoids only, expected \"trapezoid\"",
                acceleration.name()
            ),
            Self::FilamentOnTheWay => {
                write!(
                    out,
                    "filament_on_the_way = true: prepared jobs stop for filament that moves alone, expected false"
                )
            }
            Self::Job(error) => error.fmt(out),
            Self::Write(error) => write!(out, "cannot be written: {error}"),
            Self::Command(line, why) => write!(out, "line {line}: {why}"),
        }
    }
}

impl std::error::Error for PrepareError {}

/// Counts the bytes of the G-code.
struct Counted<'a, I> {
    input: &'a mut I,
    bytes: u64,
}

impl<I: Read> Read for Counted<'_, I> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.input.read(buffer)?;
        self.bytes += read as u64;
        Ok(read)
    }
}

/// The writer of the chosen encoding.
enum Parts {
    Compact(Box<FrameWriter>),
    Wide(PacketWriter),
}

/// The file being written.
struct Writer<'a, W> {
    reader: &'a PlanReader,
    out: W,
    parts: Parts,
    waiting: Vec<u8>,
    content_bytes: u64,
    failed: Option<PrepareError>,
}

impl<W: Write> Writer<'_, W> {
    fn take(&mut self, ready: &Ready) {
        if let Ready::Command { line, text } = ready
            && text.len() > ferrostep_gpre::compact::MAX_TEXT_BYTES
        {
            let why = "a command too long for a prepared job, expected at most 255 bytes";
            self.failed.get_or_insert(PrepareError::Command(*line, why));
        }
        match &mut self.parts {
            Parts::Compact(frames) => match (ready, ready.item()) {
                (Ready::State { modal, position_10nm }, _) => {
                    frames.set_modal(*modal, *position_10nm, &mut self.waiting);
                }
                (_, Some(item)) => frames.add(&item, &mut self.waiting),
                _ => {}
            },
            Parts::Wide(packets) => {
                if let Some(item) = ready.item() {
                    packets.take_item(&item, &mut self.waiting);
                }
                match ready {
                    Ready::First { planned, bound, joined, .. } => {
                        packets.take_block(planned, *bound, *joined, &mut self.waiting);
                    }
                    Ready::State { modal, position_10nm } => packets.set_modal(modal, *position_10nm),
                    _ => {}
                }
            }
        }
        if self.waiting.len() >= PORTION_BYTES {
            self.write();
        }
    }

    fn take_ready(&mut self) {
        while let Some(ready) = self.reader.with_script(Script::pop).flatten() {
            self.take(&ready);
        }
    }

    fn write(&mut self) {
        self.content_bytes += self.waiting.len() as u64;
        if let Err(error) = self.out.write_all(&self.waiting) {
            self.failed.get_or_insert(PrepareError::Write(error));
        }
        self.waiting.clear();
    }
}

impl<W: Write, P: Ports> Onlooker<P> for Writer<'_, W> {
    fn begins(&mut self, printer: &Printer<'_, P>, line: u32, text: &str) {
        let why = match parse(text) {
            _ if printer.is_macro(text) => {
                Some("a macro of the profile cannot be prepared: write its lines into the file")
            }
            Ok(Command::ShiftZ { words, .. }) if words.z.is_some() => Some(
                "M290 shifts a print by hand and cannot be prepared: put the height into the job (M851, or its G-code)",
            ),
            Ok(Command::OffsetZ { offset, .. }) if offset != Decimal::ZERO => Some(
                "SET_GCODE_OFFSET shifts a print and cannot be prepared: put the height into the job (M851, or its G-code)",
            ),
            Ok(Command::Bed(BedCommand::Align { .. })) if printer.aligns_z() => Some(
                "G34 leaves Z at a height that only the machine knows: take the line out, and send it before the job",
            ),
            Ok(Command::Bed(bed)) if bed.switches_on() && printer.has_bed() => Some(
                "a prepared job brings its own heights and follows no mesh of the bed: take the line out, or print the G-code",
            ),
            Ok(Command::Skew(skew)) if skew.may_skew() => {
                Some("a prepared job is planned for axes at right angles: take the line out, or print the G-code")
            }
            _ if printer.is_skew() => {
                Some("a prepared job is planned for axes at right angles, and the profile's are skew: print the G-code")
            }
            Ok(Command::SelectTool { tool: Some(1..), .. }) if printer.has_tools() => Some(
                "T1 changes the tool and cannot be prepared: a prepared job is for one tool, print the G-code itself",
            ),
            Ok(Command::StepsPerMm(tool, words)) if printer.changes_extruder_steps(tool, &words) => Some(
                "M92 E changes the extruder's steps and cannot be prepared: write them into the profile, and take the line out",
            ),
            Ok(Command::Tower(Some(_))) => {
                Some("TUNING_TOWER changes values while a print is made and cannot be prepared: print the G-code")
            }
            _ => None,
        };
        if let Some(why) = why {
            self.failed.get_or_insert(PrepareError::Command(line, why));
        }
        self.reader.with_script(|script| script.begins(line, text));
    }

    fn ended(&mut self, printer: &Printer<'_, P>) {
        let (modal, position) = (printer.prepared_state(), printer.machine_10nm());
        self.reader.with_script(|script| script.ended(modal, position));
        self.take_ready();
    }
}

/// Prepares a job: executes it on the desk without its steps and writes the plan.
///
/// `picture` is the slicer's, see [`super::take_thumbnail`]. The header is written again at the
/// end, when its numbers are known.
///
/// # Errors
/// See [`PrepareError`]; the content of `out` is then useless.
pub fn prepare(
    input: &mut impl Read,
    picture: Option<(Thumbnail, Vec<u8>)>,
    profile: Profile,
    replies: JobReplies<'_>,
    target: Target<impl Write + Seek>,
    mut look: impl FnMut(&JobProgress, &Figures),
) -> Result<Prepared, PrepareError> {
    if profile.motion.acceleration != AccelerationProfile::Trapezoid {
        return Err(PrepareError::Acceleration(profile.motion.acceleration));
    }
    if profile.motion.filament_on_the_way {
        return Err(PrepareError::FilamentOnTheWay);
    }
    let Target { mut out, encoding } = target;
    let mut header = Header {
        encoding,
        profile_hash: profile.plan_hash,
        planner_version: PLANNER_VERSION,
        frames: 0,
        moves: 0,
        motion_ms: 0,
        filament_100pm: 0,
        layers: 0,
        thumbnail: picture.as_ref().map(|(thumbnail, _)| *thumbnail),
    };
    let picture = picture.map_or_else(Vec::new, |(_, bytes)| bytes);
    out.write_all(&header.to_bytes(&picture)).map_err(PrepareError::Write)?;

    let session = Session::prepare(profile, LOOK_AHEAD_BLOCKS, replies);
    let mut printer = session.printer();
    let mut progress = JobProgress::default();
    let mut input = Counted { input, bytes: 0 };
    let parts = match encoding {
        Encoding::Compact => Parts::Compact(Box::new(FrameWriter::new(printer.machine_10nm(), ModalState::START))),
        Encoding::Wide => Parts::Wide(PacketWriter::new(printer.machine_10nm())),
    };
    let mut writer = Writer { reader: session.desk(), out, parts, waiting: Vec::new(), content_bytes: 0, failed: None };
    let mut watch = Watch::new(&profile, session.replies().remarks());
    let mut watching = (&mut writer, &mut watch);
    let outcome = session.run(job::run_watched(
        &mut input,
        &mut printer,
        &mut progress,
        Macros::AsOnABoard,
        &mut watching,
        |progress| {
            look(progress, &session.figures());
        },
    ));
    watch.end_of_text(outcome.is_ok());
    watch.end(&session.heating(), outcome.is_ok());
    outcome.map_err(PrepareError::Job)?;
    writer.take_ready();
    let frames = match &mut writer.parts {
        Parts::Compact(frames) => {
            frames.close(&mut writer.waiting);
            frames.frames()
        }
        Parts::Wide(packets) => packets.end(&mut writer.waiting),
    };
    writer.write();
    if let Some(error) = writer.failed {
        return Err(error);
    }

    let tally = printer.tally();
    header.frames = frames;
    header.moves = tally.moves;
    header.motion_ms = (session.figures().motion_time_s * 1000.0).round() as u64;
    header.filament_100pm = tally.filament_100pm;
    header.layers = progress.layers;
    let mut out = writer.out;
    out.seek(SeekFrom::Start(0)).map_err(PrepareError::Write)?;
    out.write_all(&header.to_bytes(&picture)).map_err(PrepareError::Write)?;
    out.flush().map_err(PrepareError::Write)?;
    Ok(Prepared {
        header,
        bytes: u64::from(header.length()) + writer.content_bytes,
        content_bytes: writer.content_bytes,
        source_bytes: input.bytes,
        progress,
        tally,
        remarks: session.replies().remarks().to_vec(),
    })
}
