//! The answer to a line: its command, or its macro's lines, and the replies that hosts read.

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{Command, Remarks, Reply, ShortText, parse_with_remarks};

use crate::error::{CommandError, Failure};
use crate::job::change_macros::NextOfChange;
use crate::job::lines::Source;
use crate::job::macros;
use crate::job::macros::{Call, MacroLine};
use crate::ports::{Motion, Ports, Replies};
use crate::printer::{Answer, Printer};

/// Delay of the answer to the first refused line after a halt, ms, so that the halt
/// is reported first.
const TELL_HALT_MS: u32 = 2;

impl<P: Ports> Printer<'_, P> {
    /// Returns true if a line calls a macro of the profile.
    pub fn is_macro(&self, text: &str) -> bool {
        macros::call(self.profile.macros, text).is_some()
    }

    /// Executes a line, or the lines of the macro that it calls, and answers it.
    pub(crate) async fn answer(&mut self, line: u32, text: &str) -> Result<(), Failure> {
        let (failure, is_stop) = match self.execute_lines(line, text, None).await {
            Ok(answer) => {
                if answer == Answer::Ok {
                    self.replies.send(Reply::Ok);
                }
                return Ok(());
            }
            Err(failed) => failed,
        };
        self.replies.refuse(line, &failure);
        if let (Failure::Command(error), Source::Host { is_numbered }) = (&failure, self.lines.source) {
            self.end_print_of_host(error, is_stop, is_numbered);
        }
        self.replies.send(Reply::Ok);
        Err(failure)
    }

    /// Executes a line, or the lines of the macro that it calls, and those of the macros before and
    /// after a tool change. `card_start` is where a line of the card's print begins.
    ///
    /// # Errors
    /// The reason why the line failed, and whether it was meant to stop or restart the machine. The
    /// macro has been named.
    pub(crate) async fn execute_lines(
        &mut self,
        line: u32,
        text: &str,
        card_start: Option<u32>,
    ) -> Result<Answer, (Failure, bool)> {
        let mut stops = self.motion.stops();
        let (mut call, mut changes, mut room) =
            (macros::call(self.profile.macros, text), Self::no_change(), MacroLine::new());
        self.lines.is_in_macro = call.is_some();
        let (failure, is_stop) = loop {
            let text = match self.next_of_change(&mut changes, &mut room) {
                Ok(NextOfChange::Line) => room.as_str(),
                Ok(NextOfChange::Ended) if call.is_none() => return Ok(Answer::Ok),
                Ok(NextOfChange::Ended | NextOfChange::NoChange) => match &mut call {
                    None => text,
                    Some(call) => match call.next_line(&mut room) {
                        Ok(true) => room.as_str(),
                        Ok(false) => return Ok(Answer::Ok),
                        Err(error) => break (Failure::Parse(error), false),
                    },
                },
                Err(error) => break (Failure::Parse(error), false),
            };
            let mut remarks = Remarks::NONE;
            let parsed = parse_with_remarks(text, &mut remarks);
            if let Ok(command) = &parsed {
                self.add_remarks(command, &mut remarks);
                if !remarks.is_empty() {
                    self.remark(line, text, &remarks);
                }
            }
            let failure = match &parsed {
                Ok(command) => match self.may_execute(line, card_start, command) {
                    // A macro continues after such a line.
                    Ok(Answer::Given) if call.is_some() => continue,
                    Ok(Answer::Given) => return Ok(Answer::Given),
                    Ok(Answer::Ok) if self.begins_change(&mut changes, command) => continue,
                    Ok(Answer::Ok) => match self.command_with_signs_of_life(command).await {
                        // A macro continues after its own M410; any other stop, also between
                        // its lines, ends it.
                        Ok(_) if matches!(command, Command::QuickStop) && call.is_some() => {
                            stops = self.motion.stops();
                            continue;
                        }
                        Ok(_) if self.lines.is_in_macro && self.motion.stops() != stops => {
                            Failure::Command(CommandError::Stopped)
                        }
                        Ok(_) if self.lines.is_in_macro => continue,
                        Ok(answer) => return Ok(answer),
                        Err(error) => Failure::Command(error),
                    },
                    Err(error) => Failure::Command(error),
                },
                Err(error) => Failure::Parse(*error),
            };
            break (failure, matches!(parsed, Ok(Command::EmergencyStop | Command::Restart)));
        };
        let is_halted = matches!(failure, Failure::Command(CommandError::Halted | CommandError::NeedsReset(_)));
        if is_halted && !self.lines.told_halted {
            // A task of lower priority reports the halt and the heater's fault; those reports must
            // come first.
            self.clock.delay_ms(TELL_HALT_MS).await;
        }
        self.tell_failed_change(line, &changes, &mut room);
        if let Some(call) = &call {
            self.tell_macro_end(line, call, &room);
        }
        Err((failure, is_stop))
    }

    /// Decides by the source whether a command may be executed now: a host's during a print from
    /// the card, or the card's own. [`Answer::Given`] means that it needs no further work.
    fn may_execute(
        &mut self,
        line: u32,
        card_start: Option<u32>,
        command: &Command<'_>,
    ) -> Result<Answer, CommandError> {
        if self.may_stand_in_file(command)? == Answer::Given {
            return Ok(Answer::Given);
        }
        match card_start {
            None if self.disturbs_print(command) => Err(CommandError::CardPrints),
            None => Ok(Answer::Ok),
            Some(start) => self.begin_card_command(line, start, command),
        }
    }

    /// Reports the line at which a macro has ended, if it has begun.
    pub(crate) fn tell_macro_end(&self, line: u32, call: &Call<'_>, text: &str) {
        if call.has_begun() {
            let (name, place, text) = (call.name(), call.place(), ShortText::new(text));
            self.replies.say(format_args!("echo:line {line}: {name}, line {place}: \"{text}\" ends the macro"));
        }
    }

    /// Ends or pauses the print of a host whose line was refused, in words that hosts know.
    /// Otherwise the host would stream the rest into a halted machine.
    #[cold]
    fn end_print_of_host(&mut self, error: &CommandError, is_stop: bool, is_numbered: bool) {
        match error {
            CommandError::Halted | CommandError::NeedsReset(_) => {
                // The answer to M112 has reported it already, and M999 does not belong to a print.
                if !is_stop {
                    self.replies.send(Reply::Killed);
                    // The form that Printrun knows.
                    self.replies.send(Reply::Text("!! the printer is halted, M999 restarts it"));
                }
                if !core::mem::replace(&mut self.lines.told_halted, true) {
                    self.replies.send(Reply::Text("//action:cancel"));
                }
            }
            _ if is_numbered && (error.fails_homing() || matches!(error, CommandError::ColdExtrusion { .. })) => {
                let text = if error.fails_homing() {
                    "//action:notification Homing has failed: home the printer (G28), then resume"
                } else {
                    "//action:notification Too cold to extrude: heat the nozzle, then resume"
                };
                self.replies.send(Reply::Text(text));
                // Printrun reads the second form only.
                self.replies.send(Reply::Text("//action:pause\n// action:pause"));
            }
            _ => {}
        }
    }

    /// Reports ignored or changed parts of a line, each once a job.
    #[cold]
    pub(crate) fn remark(&mut self, line: u32, text: &str, remarks: &Remarks) {
        let new = self.lines.said.merge(remarks);
        self.replies.remark(line, text, remarks, &new);
    }
}
