//! A print of G-code from the card.

use ferrostep_gcode::{Checksum, Command, Line, LineError, LineReader, Reply};

use super::print::{Bytes, End, HostLines};
use crate::commands::filament::lays;
use crate::error::{CommandError, Failure};
use crate::job::lines::Source;
use crate::ports::{Motion, Ports, Replies, temperatures};
use crate::printer::{Answer, Printer};

/// Maximum number of bytes taken from the card's task at once.
const CHUNK_BYTES: usize = 64;

impl<P: Ports> Printer<'_, P> {
    /// Prints from the present place on; `lines_before` lines of the file precede it.
    pub(super) async fn print_text(&mut self, hosts: &mut impl HostLines, lines_before: u32, stops: u32) -> End {
        let mut reader = LineReader::new();
        let mut chunk = [0; CHUNK_BYTES];
        let (mut at, mut end) = (0, 0);
        // Where the chunk begins in the file.
        let mut chunk_start = self.print.card.position;
        loop {
            if let Err(end) = self.answer_hosts(hosts, stops).await {
                return end;
            }
            let mut has_ended = false;
            if at == end {
                chunk_start = chunk_start.saturating_add(end as u32);
                (at, end) = match self.take_bytes(hosts, &mut chunk, stops).await {
                    Ok(Bytes::Some(length)) => (0, length),
                    Ok(Bytes::End) => {
                        has_ended = true;
                        (0, 0)
                    }
                    Err(end) => return end,
                };
            }
            let line_start = self.print.card.position;
            let (used, line) =
                if has_ended { (0, reader.finish()) } else { reader.feed(chunk.get(at..end).unwrap_or_default()) };
            at += used;
            if let Some(line) = line {
                self.print.card.position = chunk_start.saturating_add(at as u32);
                self.note_card_progress();
                if let Some(end) = self.card_line(line, lines_before, line_start).await {
                    return end;
                }
            }
            if has_ended {
                // The last line may have paused the print.
                return self.answer_hosts(hosts, stops).await.err().unwrap_or(End::Complete);
            }
        }
    }

    /// Executes a line. A refused line pauses the print. If a person can mend the reason, the line
    /// is tried again when the print resumes; otherwise the print continues after it, so that no
    /// pause is endless.
    async fn card_line(
        &mut self,
        line: Result<Line<'_>, LineError>,
        lines_before: u32,
        line_start: u32,
    ) -> Option<End> {
        self.signals.note_host();
        let number = match &line {
            Ok(line) => line.line_number,
            Err(error) => error.line_number(),
        };
        let number = number.saturating_add(lines_before);
        self.lines.number = number;
        let (mut is_refused, mut is_mendable) = (true, false);
        match line {
            Ok(line) if matches!(line.checksum, Checksum::Wrong { .. } | Checksum::Malformed) => {
                self.replies
                    .say(format_args!("echo:line {number}: the checksum is wrong: copy the file to the card again"));
            }
            Ok(line) => match self.execute_from_card(number, line_start, line.text).await {
                Ok(()) => is_refused = false,
                Err(failure) if Self::has_stopped(&failure) => return Some(End::Stopped),
                Err(failure) => {
                    self.replies.refuse(number, &failure);
                    is_mendable = matches!(failure, Failure::Command(error) if error.is_mendable());
                }
            },
            Err(error) => self.replies.say(format_args!("echo:line {number}: {error}")),
        }
        if is_refused {
            let goes_on = if is_mendable { "tries the line again" } else { "resumes after the line" };
            self.replies.say(format_args!(
                "echo:card: the print is paused at line {number}; M24 {goes_on}, M524 ends the print"
            ));
            if is_mendable {
                self.print.card.seek = Some((line_start, number.saturating_sub(1)));
                self.print.card.position = line_start;
            }
            self.pause_print().await;
        }
        None
    }

    /// Executes a line's text without an `ok`, because no host has sent it.
    async fn execute_from_card(&mut self, number: u32, line_start: u32, text: &str) -> Result<(), Failure> {
        self.lines.source = Source::Card;
        // A pause must act within seconds.
        self.motion.set_bounded_in_time(true);
        self.signals.set_at_work(true);
        if self.motion.take_switched_off() {
            self.interpreter.modal.forget_home(0b1111);
        }
        let outcome = self.execute_lines(number, text, Some(line_start)).await;
        self.follow_height();
        self.signals.set_at_work(self.is_paused());
        self.note_paused();
        outcome.map(|_| ()).map_err(|(failure, _)| failure)
    }

    /// Prepares a command of the card's file, whose line begins at `line_start`: answers or refuses
    /// some commands, and keeps the place.
    ///
    /// # Errors
    /// The command is not allowed in a print.
    pub(crate) fn begin_card_command(
        &mut self,
        number: u32,
        line_start: u32,
        command: &Command<'_>,
    ) -> Result<Answer, CommandError> {
        match command {
            // An `ok` for M105 would make hosts lose count.
            Command::ReportTemperatures => {
                self.replies.send(Reply::Temperatures(temperatures(&self.heating)));
                return Ok(Answer::Given);
            }
            Command::ReceiveJob { .. } => return Err(CommandError::NoJobs),
            Command::BlackBox { .. } => return Err(CommandError::BlackBoxInPrint),
            _ => {}
        }
        // A resumed print begins with a whole line of the file, and so with the first
        // line of a macro.
        self.keep_place(number, line_start, lays(command) && !self.lines.is_in_macro);
        Ok(Answer::Ok)
    }
}
