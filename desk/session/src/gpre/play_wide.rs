//! Prints a prepared job of packets.

use std::io::Read;

use ferrostep_gpre::{Fault, ReadError};
use ferrostep_papers::wide::{PacketPlayer, PacketReader, PacketRequest};
use ferrostep_printer::{Ports, Printer, Profile};

use super::part_reader::{PartReader, refused};
use super::stopped::Stopped;
use crate::job::{JobError, JobProgress};

/// Executes all packets.
///
/// # Errors
/// As [`super::play()`]; the caller abandons the job.
pub async fn packets<P: Ports>(
    reader: &mut PartReader<impl Read>,
    count: u32,
    profile: &Profile,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    look: &mut impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    let [.., extruder_10nm] = printer.logical_10nm();
    let mut player = PacketPlayer::new(profile, extruder_10nm);
    let outcome = execute_all(reader, count, &mut player, printer, progress, look).await;
    if outcome.is_err() {
        player.settle_extruder(printer);
    }
    outcome
}

async fn execute_all<P: Ports>(
    reader: &mut PartReader<impl Read>,
    count: u32,
    player: &mut PacketPlayer,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
    look: &mut impl FnMut(&JobProgress),
) -> Result<(), JobError> {
    let mut together = PacketReader::default();
    while let Some((packet, number, offset)) = reader.packet(count)? {
        let result = match together.take(&packet) {
            Ok(Some(request)) => execute(request, player, printer, progress).await,
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
    Err(refused(ReadError { fault: Fault::Truncated, offset: reader.offset(), frame: None }))
}

/// Executes the items of packets.
async fn execute<P: Ports>(
    request: PacketRequest<'_>,
    player: &mut PacketPlayer,
    printer: &mut Printer<'_, P>,
    progress: &mut JobProgress,
) -> Result<(), Stopped> {
    match request {
        PacketRequest::Block(block, moves) => {
            let line = block.block.line;
            progress.lines = line;
            player.block(&block, moves, printer).await.map_err(|error| Stopped::at_line(line, &error))
        }
        PacketRequest::Fan { line, power } => {
            printer.prepared_fan(line, power).await.map_err(|error| Stopped::at_line(line, &error))
        }
        PacketRequest::Place(place) => {
            player.place(&place, printer).await.map_err(|error| Stopped::at_line(progress.lines, &error))
        }
        PacketRequest::Command { line, text } => {
            progress.lines = line;
            let text = std::str::from_utf8(text).map_err(|_| Fault::Content("a command of UTF-8"))?;
            printer.execute(line, text).await.map_err(|failure| Stopped::at_command(line, text, &failure))
        }
    }
}
