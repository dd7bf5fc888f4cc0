//! A print from the card: the parts that its two kinds of files share.

use core::future::Future;

use ferrostep_card::{CardFailure, Request, Taken};
use ferrostep_gcode::{Command, Line, LineError, Reply};

use crate::commands::host::Host;
use crate::error::Failure;
use crate::job::card::Job;
use crate::job::lines::Source;
use crate::job::paused::PauseAnswer;
use crate::part::Part;
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;

/// Text from hosts while the card prints.
pub enum HostText<'a> {
    /// A line, or the reason why it cannot be read, and its host, which receives the replies from
    /// now on.
    Line(&'a mut Host, Result<Line<'a>, LineError>),
    /// A part of a line; more may be waiting.
    Part,
    /// No text is waiting.
    Nothing,
}

/// The hosts' lines during a print from the card.
pub trait HostLines {
    /// Takes the next text that has arrived, without waiting.
    fn next(&mut self) -> HostText<'_>;
    /// Sends replies to all hosts from now on, since none has asked.
    fn tell_all(&mut self);
    /// Waits briefly for bytes of a host or of the card. `idle`: the machine has no other work.
    fn wait(&mut self, idle: bool) -> impl Future<Output = ()>;
}

/// Reason why a part of a print has ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum End {
    /// The file has ended.
    Complete,
    /// The print continues elsewhere in the file.
    Elsewhere,
    /// M524.
    Aborted,
    /// Motion was stopped.
    Stopped,
}

/// The file's next bytes.
pub(super) enum Bytes {
    /// Number of bytes of text.
    Some(usize),
    /// The file has ended.
    End,
}

impl<P: Ports> Printer<'_, P> {
    /// Returns true if [`Self::print_from_card`] must be called.
    pub fn prints_from_card(&self) -> bool {
        self.print.card.job != Job::None
    }

    /// Prints the selected file to its end; hosts are answered meanwhile. `room` holds the frames
    /// of a prepared job, as for [`Self::receive_job`].
    pub async fn print_from_card(&mut self, hosts: &mut impl HostLines, room: &mut [u8]) {
        let stops = self.motion.stops();
        self.print.card.own_stops = 0;
        let end = loop {
            if self.is_returning() && !self.return_to_print().await {
                break End::Stopped;
            }
            if let Some((position, _)) = self.print.card.seek {
                if let Err(failure) = self.ask_card(Request::Seek(position)).await {
                    self.replies.say(format_args!("echo:card: byte {position} is not in the file: {failure}"));
                    break End::Stopped;
                }
                self.print.card.position = position;
            }
            let lines_before = self.print.card.seek.take().map_or(0, |(_, lines)| lines);
            let is_prepared = self.print.card.selected.is_some_and(|selected| selected.is_prepared);
            let end = if is_prepared {
                self.print_job(hosts, room, stops).await
            } else {
                self.print_text(hosts, lines_before, stops).await
            };
            if end != End::Elsewhere {
                break end;
            }
        };
        hosts.tell_all();
        self.keep_at_failure().await;
        let rested = self.command_with_signs_of_life(&Command::Finish).await;
        let is_complete = end == End::Complete && rested.is_ok();
        self.stop_print_clock(is_complete);
        match end {
            End::Complete if is_complete => self.replies.send(Reply::Text("Done printing file")),
            End::Aborted => self.end_aborted_print().await,
            End::Complete | End::Stopped | End::Elsewhere => {
                self.replies.say(format_args!("echo:card: the print has ended at byte {}", self.print.card.position));
                self.replies.send(Reply::Text("//action:cancel"));
            }
        }
        self.end_begun_tower();
        self.end_keeping();
        self.cancel();
        let _ = self.ask_card(Request::Close).await;
        self.set_card_job(Job::None);
        self.print.card.selected = None;
        self.note_card_progress();
        self.keep_statistics();
    }

    /// Answers hosts, and waits while the print is paused.
    ///
    /// # Errors
    /// The print ends, or continues elsewhere in the file.
    pub(super) async fn answer_hosts(&mut self, hosts: &mut impl HostLines, stops: u32) -> Result<(), End> {
        let mut has_rested = false;
        self.note_paused();
        loop {
            loop {
                match hosts.next() {
                    HostText::Line(host, line) => host.answer(self, line).await,
                    HostText::Part => {}
                    HostText::Nothing => break,
                }
            }
            hosts.tell_all();
            self.keep_while_paused();
            if self.has_supply_failed() {
                return Err(End::Stopped);
            }
            self.follow_answer().await;
            if self.print.card.aborted {
                return Err(End::Aborted);
            }
            if self.signals.is_halted() || self.motion.stops() != stops.wrapping_add(self.print.card.own_stops) {
                return Err(End::Stopped);
            }
            if self.print.card.job == Job::Printing {
                return if self.print.card.seek.is_some() { Err(End::Elsewhere) } else { Ok(()) };
            }
            if !has_rested {
                // The machine comes to a standstill, so that a host may move the head.
                has_rested = true;
                let _ = self.command_with_signs_of_life(&Command::Finish).await;
                continue;
            }
            hosts.wait(true).await;
        }
    }

    /// Acts on a person's answer: continues a paused print, or first pushes more filament.
    async fn follow_answer(&mut self) {
        let done = match self.take_answer() {
            None => return,
            Some(PauseAnswer::Continue) => self.start_print(None).await,
            Some(PauseAnswer::PushMore) => self.push_more().await,
        };
        if let Err(error) = done {
            self.replies.refuse(self.lines.number, &Failure::Command(error));
        }
    }

    /// The file's next bytes. If the card fails, the print is paused until M24.
    ///
    /// # Errors
    /// The print ends, or continues elsewhere in the file.
    pub(super) async fn take_bytes(
        &mut self,
        hosts: &mut impl HostLines,
        out: &mut [u8],
        stops: u32,
    ) -> Result<Bytes, End> {
        loop {
            let mut taken = Taken::Failed(CardFailure::NotMounted);
            if let Some(port) = self.print.card.port {
                port.with(&mut |mailbox| taken = mailbox.take(out));
            }
            match taken {
                Taken::Bytes(length) => return Ok(Bytes::Some(length)),
                Taken::End => return Ok(Bytes::End),
                Taken::Wait => hosts.wait(true).await,
                Taken::Failed(failure) => {
                    hosts.tell_all();
                    self.replies
                        .say(format_args!("echo:card: {failure}; the print is paused, put the card back and send M24"));
                    self.pause_print().await;
                }
            }
            self.answer_hosts(hosts, stops).await?;
        }
    }

    /// Returns true if a print from the card is under way and the present line
    /// comes from elsewhere.
    pub(crate) fn is_of_other_print(&self) -> bool {
        self.print.card.job == Job::Printing && self.lines.source != Source::Card
    }

    /// Returns true if a host's command would move the head or change how the lines of the file are
    /// read, while the card prints.
    pub(crate) fn disturbs_print(&self, command: &Command<'_>) -> bool {
        self.print.card.job == Job::Printing
            && match command {
                Command::Bed(bed) => self.has_bed() && !bed.is_query(),
                // M306 T is an autotune.
                Command::HeaterModel { words, .. } => {
                    <P::Heating as Heating>::Models::PRESENT && words.contains(['T', 't'])
                }
                _ => matches!(
                    command,
                    Command::Linear { .. }
                        | Command::Arc { .. }
                        | Command::Retract
                        | Command::Recover
                        | Command::SetUnits(_)
                        | Command::Home { .. }
                        | Command::AbsolutePositioning
                        | Command::RelativePositioning
                        | Command::SetPosition(_)
                        | Command::DisableMotors(_)
                        | Command::AbsoluteExtrusion
                        | Command::RelativeExtrusion
                        | Command::AdaptiveExtrusion { .. }
                        | Command::ReceiveJob { .. }
                        | Command::Autotune { .. }
                        | Command::SelectTool { tool: Some(_), .. }
                        | Command::ToolOffset { .. }
                ),
            }
    }

    /// Returns true if a failure has stopped the machine, not only refused the line.
    pub(super) fn has_stopped(failure: &Failure) -> bool {
        matches!(failure, Failure::Command(error) if error.stops())
    }
}
