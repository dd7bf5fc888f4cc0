//! The answer to a line: its command, or its macro's lines, and what hosts read.

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{Command, Remarks, Reply, ShortText, parse_with_remarks};

use crate::error::{CommandError, Failure};
use crate::macros::{self, MacroLine};
use crate::ports::{Motion, Ports, Replies};
use crate::printer::{Answer, Printer, Source};

/// How long the answer to the first refused line after a halt waits, ms, so that the halt is reported first.
const TELL_HALT_MS: u32 = 2;

impl<P: Ports> Printer<'_, P> {
    /// Whether a line calls a macro of the profile.
    pub fn is_macro(&self, text: &str) -> bool {
        macros::call(self.profile.macros, text).is_some()
    }

    /// Executes a line, or the lines of the macro that it calls, and answers it.
    pub(crate) async fn answer(&mut self, line: u32, text: &str) -> Result<(), Failure> {
        let stops = self.motion.stops();
        let (mut call, mut room) = (macros::call(self.profile.macros, text), MacroLine::new());
        self.is_in_macro = call.is_some();
        let (failure, is_stop) = loop {
            let text = match &mut call {
                None => text,
                Some(call) => match call.next_line(&mut room) {
                    Ok(true) => room.as_str(),
                    Ok(false) => {
                        self.replies.send(Reply::Ok);
                        return Ok(());
                    }
                    Err(error) => break (Failure::Parse(error), false),
                },
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
                Ok(command) if self.disturbs_print(command) => Failure::Command(CommandError::CardPrints),
                Ok(command) => match self.command_with_signs_of_life(command).await {
                    // Between the lines of a macro, too, a stop is one of all that is at work.
                    Ok(_) if call.is_some() && self.motion.stops() != stops => Failure::Command(CommandError::Stopped),
                    Ok(_) if call.is_some() => continue,
                    Ok(answer) => {
                        if answer == Answer::Ok {
                            self.replies.send(Reply::Ok);
                        }
                        return Ok(());
                    }
                    Err(error) => Failure::Command(error),
                },
                Err(error) => Failure::Parse(*error),
            };
            break (failure, matches!(parsed, Ok(Command::EmergencyStop | Command::Restart)));
        };
        let is_halted = matches!(failure, Failure::Command(CommandError::Halted | CommandError::NeedsReset(_)));
        if is_halted && !self.told_halted {
            // A task below this one reports the halt and the heater's fault; they must come first.
            self.clock.delay_ms(TELL_HALT_MS).await;
        }
        if let Some(call) = call.as_ref().filter(|call| call.has_begun()) {
            let (name, place, text) = (call.name(), call.place(), ShortText::new(&room));
            self.replies.say(format_args!("echo:line {line}: {name}, line {place}: \"{text}\" ends the macro"));
        }
        self.replies.refuse(line, &failure);
        if let (Failure::Command(error), Source::Host { is_numbered }) = (&failure, self.source) {
            self.end_print_of_host(error, is_stop, is_numbered);
        }
        self.replies.send(Reply::Ok);
        Err(failure)
    }

    /// Ends or pauses the print of a host whose line was refused, in words that hosts know. Otherwise they would stream the rest
    /// into a machine that does nothing.
    #[cold]
    fn end_print_of_host(&mut self, error: &CommandError, is_stop: bool, is_numbered: bool) {
        match error {
            CommandError::Halted | CommandError::NeedsReset(_) => {
                // The answer to M112 has told it already, and M999 is no line of a print.
                if !is_stop {
                    self.replies.send(Reply::Killed);
                    // Printrun's word.
                    self.replies.send(Reply::Text("!! the printer is halted, M999 restarts it"));
                }
                if !core::mem::replace(&mut self.told_halted, true) {
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

    /// Reports what is ignored or changed in a line, each thing once a job.
    #[cold]
    pub(crate) fn remark(&mut self, line: u32, text: &str, remarks: &Remarks) {
        let new = self.said.merge(remarks);
        self.replies.remark(line, text, remarks, &new);
    }
}
