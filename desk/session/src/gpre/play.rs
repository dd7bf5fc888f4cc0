//! Prints a prepared job.

use std::io::Read;

use ferrostep_gpre::compact::Decoder;
use ferrostep_gpre::{Encoding, Item};
use ferrostep_planner::PLANNER_VERSION;
use ferrostep_printer::{CommandError, Ports, Printer, Profile};

use super::entry::{self, Passed};
use super::part_reader::{PartReader, refused};
use super::play_wide::packets;
use super::stopped::Stopped;
use crate::job::{JobError, JobProgress};

/// Executes a prepared job and waits for the end of its motion.
///
/// A fault ends the job; the moves taken before it are executed, to a standstill on the path.
///
/// # Errors
/// A `ReadError` or a `CommandError`, with the frame and its place.
pub async fn play<P: Ports>(
    input: &mut impl Read,
    profile: &Profile,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    look: impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    play_from(0, input, profile, printer, progress, look).await
}

/// Plays a job as [`play`] does, from a frame on. First brings the machine to the frame's start,
/// except for frame 0, the job's start.
///
/// # Errors
/// As [`play`], and [`JobError::Entry`] if there is no such frame, the job cannot be entered there,
/// or the machine cannot be brought there.
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
    progress.motion_time_s = (from == 0).then_some(header.motion_ms as f64 * 1e-3);
    if from >= header.frames.max(1) {
        return Err(entry::no_such_frame(from, header.frames));
    }
    let outcome = match header.encoding {
        Encoding::Compact => {
            let job = Frames { count: header.frames, from, profile };
            frames(&mut reader, &job, printer, progress, &mut look).await
        }
        Encoding::Wide if from > 0 => return Err(entry::no_frames(from)),
        Encoding::Wide => packets(&mut reader, header.frames, profile, printer, progress, &mut look).await,
    };
    if let Err(error) = outcome {
        // The reason has been reported; a halt is known already.
        let _ = printer.abandon_prepared().await;
        return Err(error);
    }
    let Err(error) = printer.finish().await else { return Ok(()) };
    let _ = printer.abandon_prepared().await;
    Err(match error {
        CommandError::Plan(_) => {
            let (frame, line) = (header.frames.checked_sub(1), Some(progress.lines));
            JobError::Prepared { frame, line, offset: reader.offset(), message: error.to_string() }
        }
        error => JobError::Stopped(error),
    })
}

/// Frames to be executed.
struct Frames<'a> {
    /// Number of the file's frames.
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

/// Executes the items of a frame.
async fn execute<P: Ports>(
    items: &mut Decoder<'_>,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
) -> Result<(), Stopped> {
    let start = *items.start();
    let mut begun = false;
    let at = |line: u32| move |error: CommandError| Stopped::at_line(line, &error);
    while let Some(item) = items.next_item()? {
        match item {
            Item::Move(next) => {
                progress.lines = next.line;
                // A Z that M290 has shifted is not reported here: the move itself
                // is refused for it.
                if !begun && printer.machine_10nm() != start.position_10nm && !printer.is_shifted() {
                    let message =
                        "the frame does not begin where the one before ended: prepare the job again".to_owned();
                    return Err(Stopped::new(next.line, message));
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
