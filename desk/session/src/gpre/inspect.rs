//! A prepared job in words.

use std::io::{self, Read, Write};

use ferrostep_gpre::compact::FrameState;
use ferrostep_gpre::{Encoding, EntrySpeed, Header, Item};
use ferrostep_host::printable::one_line;

use super::part_reader::PartReader;
use crate::duration::hms;
use crate::job::JobError;

/// Reason for which the inspection of a file ended early.
pub enum InspectError {
    /// The file cannot be read.
    Job(JobError),
    /// The text cannot be written.
    Write(io::Error),
}

impl From<JobError> for InspectError {
    fn from(error: JobError) -> Self {
        Self::Job(error)
    }
}

impl From<io::Error> for InspectError {
    fn from(error: io::Error) -> Self {
        Self::Write(error)
    }
}

fn mm(length_10nm: i64) -> f64 {
    length_10nm as f64 / 100_000.0
}

fn say_header(header: &Header, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "encoding     {:?}", header.encoding)?;
    writeln!(out, "profile      {:016x}", header.profile_hash)?;
    writeln!(out, "planner      version {}", header.planner_version)?;
    writeln!(out, "time         {} in motion", hms(header.motion_ms as f64 / 1000.0))?;
    writeln!(out, "filament     {:.3} m", header.filament_100pm as f64 / 1e10)?;
    writeln!(out, "moves        {}, {} layers, {} frames", header.moves, header.layers, header.frames)?;
    match header.thumbnail {
        Some(picture) => writeln!(
            out,
            "thumbnail    {:?}, {} x {}, {} bytes",
            picture.format, picture.width, picture.height, picture.length
        ),
        None => writeln!(out, "thumbnail    none"),
    }
}

fn say_start(state: &FrameState, out: &mut impl Write) -> io::Result<()> {
    let [x, y, z] = state.position_10nm.map(mm);
    let modal = &state.modal;
    writeln!(
        out,
        "  begins at X{x:.5} Y{y:.5} Z{z:.5}, E {:.5}, after line {}; feed {} mm/s ({} %), flow {} %, fan {}, nozzle {} C, \
         bed {} C{}{}",
        mm(modal.extruder_10nm),
        state.line,
        state.feed_mm_per_s,
        modal.feed_percent,
        modal.flow_percent,
        state.fan_power,
        modal.nozzle_celsius,
        modal.bed_celsius,
        if modal.limits.is_some() { ", separate limits" } else { "" },
        if state.can_be_entered { "" } else { "; cannot be entered here" },
    )
}

fn say_item(item: &Item<'_>, out: &mut impl Write) -> io::Result<()> {
    match item {
        Item::Move(next) => {
            let [x, y, z] = next.target_10nm().map(|coordinate| mm(coordinate.into()));
            let filament = next.filament_100pm as f64 / 1e7;
            let (line, feed) = (next.line, next.feed_mm_per_s);
            write!(out, "  {line:>7}  X{x:.5} Y{y:.5} Z{z:.5} E{filament:+.5} F{feed} mm/s, ")?;
            match next.entry {
                EntrySpeed::Continues => writeln!(out, "continues"),
                EntrySpeed::Bound => writeln!(out, "entry by corner and feed"),
                EntrySpeed::Falling => writeln!(out, "entry by braking"),
                EntrySpeed::Given(squared) => {
                    writeln!(out, "entry {:.4} mm/s", (squared.units() as f64 / 12_800_000.0).sqrt())
                }
            }
        }
        Item::Fan { line, power } => writeln!(out, "  {line:>7}  fan {power}"),
        Item::Command { line, text } => writeln!(out, "  {line:>7}  {}", one_line(text)),
    }
}

/// Parts of a prepared job to show after its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// Beginnings of the frames.
    Frames,
    /// Every frame and item.
    Items,
    /// The frames at which the job can be entered, a line each.
    Entries,
}

/// A frame at which the job can be entered.
struct OpenFrame {
    number: u32,
    line: u32,
    z_10nm: i64,
    /// Time of all moves before it at their feeds, s.
    before_s: f64,
}

/// The entries of a job, and the time of its moves at their feeds.
#[derive(Default)]
struct Entries {
    entries: Vec<OpenFrame>,
    at_feeds_s: f64,
    position_10nm: [i64; 3],
}

impl Entries {
    /// A frame begins.
    fn begin(&mut self, number: u32, start: &FrameState) {
        self.position_10nm = start.position_10nm;
        // The start of the job is entered as usual.
        if start.can_be_entered && number > 0 {
            let z_10nm = start.position_10nm[2];
            self.entries.push(OpenFrame { number, line: start.line, z_10nm, before_s: self.at_feeds_s });
        }
    }

    fn pass(&mut self, item: &Item<'_>) {
        let Item::Move(next) = item else { return };
        let target_10nm = next.target_10nm().map(i64::from);
        let [x, y, z] = [0, 1, 2].map(|axis| mm(target_10nm[axis] - self.position_10nm[axis]));
        let way_mm = x.hypot(y).hypot(z);
        let length_mm = if way_mm > 0.0 { way_mm } else { (next.filament_100pm as f64 / 1e7).abs() };
        self.at_feeds_s += length_mm / f64::from(next.feed_mm_per_s);
        self.position_10nm = target_10nm;
    }

    /// Writes the entries. Their times are shares of the job's time, by the time of the
    /// moves at their feeds.
    fn say(&self, header: &Header, out: &mut impl Write) -> io::Result<()> {
        writeln!(out, "can be entered at")?;
        writeln!(out, "{:>8} {:>10} {:>10}   {:>16}", "frame", "after line", "Z, mm", "in motion before")?;
        for entry in &self.entries {
            let share = if self.at_feeds_s > 0.0 { entry.before_s / self.at_feeds_s } else { 0.0 };
            let before = format!("about {}", hms(share * header.motion_ms as f64 / 1000.0));
            writeln!(out, "{:>8} {:>10} {:>10.3}   {before:>16}", entry.number, entry.line, mm(entry.z_10nm))?;
        }
        Ok(())
    }
}

/// Writes the header of a prepared job and the parts that `shown` names.
///
/// # Errors
/// The file's fault, after the part that could be read; or `out` cannot be written.
pub fn inspect(input: impl Read, shown: Shown, out: &mut impl Write) -> Result<(), InspectError> {
    let all = shown == Shown::Items;
    let mut entries = Entries::default();
    let mut reader = PartReader::new(input);
    let header = reader.header()?;
    say_header(&header, out)?;
    if header.encoding == Encoding::Wide {
        if shown == Shown::Entries {
            writeln!(out, "packets cannot be entered")?;
        }
        while let Some((packet, number, offset)) = reader.packet(header.frames)? {
            if all {
                writeln!(out, "{number} at byte {offset}: {packet:?}")?;
            }
        }
        return Ok(());
    }
    while let Some((frame, offset)) = reader.frame(header.frames)? {
        let number = frame.number;
        let fail = |fault: ferrostep_gpre::Fault| JobError::Prepared {
            frame: Some(number),
            line: None,
            offset,
            message: fault.to_string(),
        };
        let mut items = frame.items().map_err(fail)?;
        if shown == Shown::Entries {
            entries.begin(number, items.start());
        } else {
            writeln!(out, "frame {number} at byte {offset}")?;
            say_start(items.start(), out)?;
        }
        while let Some(item) = items.next_item().map_err(fail)? {
            match shown {
                Shown::Frames => {}
                Shown::Items => say_item(&item, out)?,
                Shown::Entries => entries.pass(&item),
            }
        }
    }
    if shown == Shown::Entries {
        entries.say(&header, out)?;
    }
    Ok(())
}
