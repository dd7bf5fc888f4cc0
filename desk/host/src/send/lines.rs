//! Sends G-code line by line, with numbers and checksums, waiting for one `ok` per line.

use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::time::Instant;

use ferrostep_gcode::meatpack;

use super::error::SendError;
use super::meeting::{Met, meet};
use super::packing::Packing;
use super::port::{HALTED, Patience, Port};
use super::protocol::{is_report, is_transfer_error, numbered, resend, unknown};
use super::watch::Watch;
use crate::file_lines::command_of;

/// Number of sent lines kept in case the printer asks for them again. Only one is under way at a
/// time; a printer that was sent a line twice may lag by one more.
const KEPT_LINES: usize = 16;

/// Maximum number of times that a line is sent. A line that never arrives intact would otherwise be
/// repeated forever.
const MOST_TIMES: u32 = 100;

/// Maximum number of lines kept from a printer's answer to one line.
const MAX_SAID: usize = 20;

/// Reason why a printer or a person ended a job early.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The printer reports an error; the text of its line.
    Error(String),
    /// The printer asks its host to cancel the job.
    Cancelled,
    /// The printer was reset: it has sent `start`.
    Reset,
    /// [`Watch::wants_end`] returned true.
    Asked,
    /// The printer did not start to write the file; the command, and the printer's answer.
    NotWriting(String, Vec<String>),
    /// The printer did not write all of the file; its answer.
    NotWritten(Vec<String>),
    /// The file contains a command that would end its own upload or stop the printer; the command.
    NotForCard(String),
    /// The next line of the file is damaged; description of the damage.
    Damaged(String),
    /// The printer counts lines differently from the host: the line that it asks for, and the one
    /// that it was sent.
    OtherCount(u32, u32),
    /// The printer keeps asking for the same line; the line's number in the conversation.
    NeverArrives(u32),
}

impl fmt::Display for Stop {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Error(line) => write!(out, "the printer reports: {line}"),
            Self::Cancelled => out.write_str("the printer has cancelled the job (//action:cancel)"),
            Self::Reset => out.write_str("the printer was reset in the middle of the job: start it again"),
            Self::Asked => out.write_str("stopped by Ctrl-C"),
            Self::NotWriting(command, said) => write!(out, "the printer refuses {command}: {}", said.join("; ")),
            Self::NotWritten(said) => write!(out, "the printer has not written the file: {}", said.join("; ")),
            Self::NotForCard(command) => {
                write!(
                    out,
                    "the next command is {command}, which would act now and not be written: remove it from the file"
                )
            }
            Self::Damaged(how) => write!(out, "the next command is damaged: {how}"),
            Self::OtherCount(asked, sent) => write!(
                out,
                "the printer asks for line {asked} of the conversation where line {sent} was sent and all before were answered: \
                 what it has executed is not known; was it reset, or does another host send lines?"
            ),
            Self::NeverArrives(number) => write!(
                out,
                "the printer has asked for line {number} of the conversation {MOST_TIMES} times: is the cable in order?"
            ),
        }
    }
}

/// Result of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Line of the file up to which commands were answered.
    pub file_line: u32,
    /// Number of commands sent, each counted once.
    pub sent: u32,
    /// Number of repeated lines.
    pub resends: u32,
    /// Reason why the job ended early, if it did.
    pub stop: Option<Stop>,
}

/// Reads the bytes of a file's next line.
type NextLine<'a> = &'a mut dyn FnMut() -> Option<io::Result<Vec<u8>>>;

/// Commands sent before and after those of the file.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Commands before the file's first line.
    pub opening: &'a [&'a str],
    /// Commands after the file's last line.
    pub closing: &'a [&'a str],
    /// True if the printer writes the lines to a file instead of executing them.
    pub is_upload: bool,
}

/// Lines by which a printer reports that it starts to write a file, and that it has finished.
const WRITING: &str = "Writing to file";
const WRITTEN: &str = "Done saving file";

/// Last line of a print and the text that the printer answers. The line has a number like the
/// others: a printer that has missed a line asks for that one instead, whatever it has answered
/// before.
const LAST_LINE: &str = "M118 ferrostep: this was the last line";
const LAST: &[&str] = &[LAST_LINE];
/// Maximum number of times that the last line is sent.
const MOST_LAST_LINES: u32 = 10;
const LAST_LINE_SAID: &str = "ferrostep: this was the last line";

impl Frame<'_> {
    /// Sends only the file's commands, then waits for the end of the motion.
    pub const PLAIN: Self = Self { opening: &[], closing: &["M400", LAST_LINE], is_upload: false };
    /// Like [`Self::PLAIN`], with a temperature report every two seconds.
    pub const WITH_TEMPERATURES: Self =
        Self { opening: &["M155 S2"], closing: &["M400", "M155 S0", LAST_LINE], is_upload: false };
}

/// Turns the file's lines into numbered commands.
struct Source<'a> {
    next: NextLine<'a>,
    opening: std::slice::Iter<'a, &'a str>,
    closing: std::slice::Iter<'a, &'a str>,
    file_line: u32,
    number: u32,
    /// Number of commands taken from the file.
    sent: u32,
    is_upload: bool,
}

impl Source<'_> {
    /// Returns the next command; `None` after the last one.
    fn take(&mut self) -> io::Result<Result<Option<Command>, Stop>> {
        let (text, expects) = match self.opening.next() {
            Some(text) => (Some((*text).to_owned()), self.is_upload.then_some(WRITING)),
            None => match self.take_of_file()? {
                Ok(Some(text)) => (Some(text), None),
                Ok(None) => match self.closing.next().copied() {
                    Some(LAST_LINE) => (Some(LAST_LINE.to_owned()), Some(LAST_LINE_SAID)),
                    text => (text.map(str::to_owned), self.is_upload.then_some(WRITTEN)),
                },
                Err(stop) => return Ok(Err(stop)),
            },
        };
        Ok(Ok(text.map(|text| {
            self.number += 1;
            Command { number: self.number, file_line: self.file_line, text, expects }
        })))
    }

    /// Numbers a command that is not from the file.
    fn insert(&mut self, text: String) -> Command {
        self.number += 1;
        Command { number: self.number, file_line: self.file_line, text, expects: None }
    }

    /// Returns the file's next command.
    fn take_of_file(&mut self) -> io::Result<Result<Option<String>, Stop>> {
        while let Some(line) = (self.next)() {
            let line = line?;
            match command_of(&line) {
                Ok(command) => {
                    self.file_line += 1;
                    if command.is_some() {
                        self.sent += 1;
                        return Ok(Ok(command));
                    }
                }
                Err(damaged) => return Ok(Err(Stop::Damaged(damaged.to_string()))),
            }
        }
        Ok(Ok(None))
    }
}

/// Command on its way to the printer.
struct Command {
    number: u32,
    file_line: u32,
    text: String,
    /// The beginning of a line that the printer must send before its `ok`.
    expects: Option<&'static str>,
}

impl Command {
    /// Returns true if the command must not be part of an upload: it acts as soon as its bytes
    /// arrive, or ends the upload.
    fn acts_in_upload(&self) -> bool {
        use ferrostep_gcode::{CardCommand, Command as Parsed, parse};
        self.expects.is_none()
            && matches!(parse(&self.text), Ok(Parsed::EmergencyStop | Parsed::Card(CardCommand::EndWrite)))
    }
}

/// The result of waiting for the answer to a line.
enum Answer {
    Ok,
    Again(u32),
    /// The printer did not repeat the text of the last line, or the text was lost.
    NoText,
    Stop(Stop),
}

/// State of the conversation with a printer.
struct Sending<'a, P, W> {
    port: &'a mut P,
    packing: Packing,
    patience: Patience,
    watch: &'a mut W,
    /// True once the printer has answered anything. Until then a `start` does not mean a reset.
    is_known: bool,
    is_held: bool,
    /// Lines that the printer has sent about the current line.
    said: Vec<String>,
    /// Number of outstanding answers to M108, which no line waits for.
    beside: u32,
    /// Number of the current line, and how often it was sent.
    line: u32,
    times: u32,
    /// True if the printer repeats the text of M118.
    repeats_text: bool,
    /// Maximum number of lines by which the printer may lag behind its answers. A line that was
    /// repeated because the printer was silent may get two answers, as may a damaged line that was
    /// cut in two; the second answer is then taken for the answer to the next line. A line that the
    /// printer calls unknown, quoting a text that was not sent, was damaged and yet answered.
    may_lack: u32,
    /// Number of late answers that may still arrive: one for each line that was repeated because
    /// the printer was silent, since it may only have been slow.
    owed: u32,
}

impl<P: Port, W: Watch> Sending<'_, P, W> {
    /// Sends a command with its number and waits for the printer's answer, including the line that
    /// it `expects`.
    fn ask(&mut self, number: u32, command: &str, expects: Option<&str>) -> Result<Answer, SendError> {
        let line = &numbered(number, command);
        // An `ok` to the last line without its text answers an earlier line. If the printer repeats
        // no texts, silence shows that no answer is owed.
        let waits_for_text = expects == Some(LAST_LINE_SAID) && self.repeats_text;
        let mut may_be_earlier = expects == Some(LAST_LINE_SAID);
        self.port.send(&self.packing.bytes(line))?;
        let (mut heard_at, mut asked_at) = (self.port.now(), self.port.now());
        // Last sign that the printer is working on a line.
        let mut at_work = heard_at;
        let (mut again, mut is_answered) = (None, false);
        loop {
            if self.watch.wants_end() {
                return Ok(Answer::Stop(Stop::Asked));
            }
            if self.watch.wants_wait_ended() {
                self.beside += 1;
                self.port.send(&self.packing.bytes("M108\n"))?;
            }
            let now = self.port.now();
            let Some(said) = self.port.receive(now + self.patience.look)? else {
                if now.duration_since(heard_at) > self.patience.give_up && !self.is_held {
                    return Err(SendError::Silent(vec![format!("(nothing after {:?})", line.trim_end())]));
                }
                if now.duration_since(asked_at.max(at_work)) >= self.patience.repeat && !self.is_held {
                    if waits_for_text {
                        return Ok(Answer::NoText);
                    }
                    if is_answered {
                        // All owed answers have arrived.
                        self.owed = 0;
                        return Ok(Answer::Ok);
                    }
                    // The line or its answer was lost. A printer that has already executed the line
                    // only answers it.
                    asked_at = now;
                    self.owed = if may_be_earlier { 0 } else { self.owed.saturating_add(1) };
                    may_be_earlier = false;
                    (self.times, self.may_lack) = (self.times.saturating_add(1), self.may_lack.saturating_add(1));
                    self.port.send(&self.packing.bytes(line))?;
                }
                continue;
            };
            heard_at = self.port.now();
            if !is_report(&said) {
                at_work = heard_at;
            }
            if !said.starts_with(LAST_LINE_SAID) {
                self.watch.hear(&said);
            }
            if self.said.len() < MAX_SAID {
                self.said.push(said.clone());
            }
            if let Some(stop) = self.stop_of(&said)? {
                return Ok(Answer::Stop(stop));
            }
            if let Some(number) = resend(&said) {
                again = Some(number);
            }
            if unknown(&said).is_some_and(|quoted| !command.starts_with(quoted)) {
                self.may_lack = self.may_lack.saturating_add(1);
            }
            if said.starts_with("ok") {
                self.is_known = true;
                if again.is_none() && self.beside > 0 {
                    self.beside -= 1;
                    continue;
                }
                if again.is_none() && (self.owed > 0 || may_be_earlier) && !self.has_said(expects) {
                    self.owed = self.owed.saturating_sub(1);
                    is_answered = !may_be_earlier;
                    continue;
                }
                return Ok(again.map_or(Answer::Ok, Answer::Again));
            }
        }
    }

    /// Returns true if the printer has sent the line that the current command `expects`.
    fn has_said(&self, expects: Option<&str>) -> bool {
        expects.is_none_or(|expects| self.said.iter().any(|said| said.starts_with(expects)))
    }

    /// Returns the stop reason if a line from the printer ends the job. Updates whether the job is
    /// held.
    fn stop_of(&mut self, said: &str) -> Result<Option<Stop>, SendError> {
        if said.starts_with(HALTED) {
            return Err(SendError::Halted(said.to_owned()));
        }
        if let Some(action) = said.strip_prefix("//action:") {
            match action.split(' ').next().unwrap_or_default() {
                "cancel" => return Ok(Some(Stop::Cancelled)),
                "pause" | "paused" => self.hold(true),
                "resume" | "resumed" => self.hold(false),
                _ => {}
            }
        }
        if said == "start" && self.is_known {
            return Ok(Some(Stop::Reset));
        }
        let is_error = said.starts_with("Error:") || said.starts_with("!!");
        Ok((is_error && !is_transfer_error(said)).then(|| Stop::Error(said.to_owned())))
    }

    /// Returns the line to send when the printer asks for one: the current line, an earlier one
    /// that it may have missed, or the next one if it has received both copies of the current line.
    /// Any other number means that the printer counts differently.
    fn line_asked_for(&mut self, asked: u32) -> Result<u32, Stop> {
        let other_count = Err(Stop::OtherCount(asked, self.line));
        match self.line.checked_sub(asked) {
            Some(behind) => {
                let Some(left) = self.may_lack.checked_sub(behind) else { return other_count };
                self.may_lack = left.saturating_add(1);
            }
            None if asked == self.line.saturating_add(1) && self.times > 1 => {}
            None => return other_count,
        }
        if self.times >= MOST_TIMES { Err(Stop::NeverArrives(self.line)) } else { Ok(asked) }
    }

    fn hold(&mut self, is_held: bool) {
        if std::mem::replace(&mut self.is_held, is_held) != is_held {
            self.watch.held(is_held);
        }
    }

    /// Listens while the job is held.
    fn wait_while_held(&mut self) -> Result<Option<Stop>, SendError> {
        while self.is_held {
            if self.watch.wants_end() {
                return Ok(Some(Stop::Asked));
            }
            if self.watch.wants_wait_ended() {
                // The printer is not waiting: it has answered, and the host holds the job.
                self.hold(false);
                break;
            }
            let until: Instant = self.port.now() + self.patience.look;
            if let Some(said) = self.port.receive(until)? {
                self.watch.hear(&said);
                if let Some(stop) = self.stop_of(&said)? {
                    return Ok(Some(stop));
                }
            }
        }
        Ok(None)
    }
}

/// Sends G-code with numbers and checksums, framed by the commands in `frame`, and repeats lines
/// that the printer asks for. `next` returns the bytes of the file's next line. Packing is switched
/// off at the end in any case.
///
/// # Errors
/// The file cannot be read; or the printer does not answer, has halted, or is gone.
pub fn send_lines(
    port: &mut impl Port,
    packing: Packing,
    next: impl FnMut() -> Option<io::Result<Vec<u8>>>,
    frame: Frame<'_>,
    patience: Patience,
    watch: &mut impl Watch,
) -> Result<Outcome, SendError> {
    let outcome = send_each(port, packing, next, frame, patience, watch);
    if packing == Packing::MeatPack {
        let ended = port.send(&meatpack::END);
        let outcome = outcome?;
        ended?;
        return Ok(outcome);
    }
    outcome
}

fn send_each(
    port: &mut impl Port,
    packing: Packing,
    mut next: impl FnMut() -> Option<io::Result<Vec<u8>>>,
    frame: Frame<'_>,
    patience: Patience,
    watch: &mut impl Watch,
) -> Result<Outcome, SendError> {
    let (opening, closing) = (frame.opening.iter(), frame.closing.iter());
    let mut source =
        Source { next: &mut next, opening, closing, file_line: 0, number: 0, sent: 0, is_upload: frame.is_upload };
    let mut outcome = Outcome { file_line: 0, sent: 0, resends: 0, stop: None };
    let repeats_text = match meet(port, packing, patience, watch)? {
        Met::Printer { repeats_text } => repeats_text,
        Met::EndWanted => return Ok(Outcome { stop: Some(Stop::Asked), ..outcome }),
    };
    let mut sending = Sending {
        port,
        packing,
        patience,
        watch,
        is_known: false,
        is_held: false,
        said: Vec::new(),
        beside: 0,
        line: 0,
        times: 0,
        repeats_text,
        may_lack: 0,
        owed: 0,
    };
    loop {
        match sending.ask(0, "M110 N0", None)? {
            Answer::Ok => break,
            Answer::Again(_) | Answer::NoText => outcome.resends += 1,
            Answer::Stop(stop) => return Ok(Outcome { stop: Some(stop), ..outcome }),
        }
    }
    sending.said.clear();
    let mut kept: VecDeque<Command> = VecDeque::with_capacity(KEPT_LINES);
    // Number of the line to send next: a kept line or a new one.
    let (mut number, mut last_lines) = (1, 0);
    loop {
        if let Some(stop) = sending.wait_while_held()? {
            return Ok(Outcome { stop: Some(stop), ..outcome });
        }
        if kept.back().is_none_or(|last| last.number < number) {
            let between = sending.watch.command_between().map(|text| source.insert(text));
            let next = match between {
                Some(command) => Some(command),
                None => match source.take()? {
                    Ok(next) => next,
                    Err(stop) => return Ok(Outcome { stop: Some(stop), ..outcome }),
                },
            };
            let Some(command) = next else {
                return Ok(outcome);
            };
            outcome.sent = source.sent;
            if kept.len() == KEPT_LINES {
                kept.pop_front();
            }
            kept.push_back(command);
        }
        let Some(command) = kept.iter().find(|command| command.number == number) else {
            return Ok(Outcome { stop: Some(Stop::OtherCount(number, sending.line)), ..outcome });
        };
        if frame.is_upload && command.acts_in_upload() {
            return Ok(Outcome { stop: Some(Stop::NotForCard(command.text.clone())), ..outcome });
        }
        sending.times = if sending.line == number { sending.times.saturating_add(1) } else { 1 };
        sending.line = number;
        match sending.ask(number, &command.text, command.expects)? {
            Answer::Ok => {
                let has_said = sending.has_said(command.expects);
                let said = std::mem::take(&mut sending.said);
                if !has_said && command.expects != Some(LAST_LINE_SAID) {
                    let said = said.into_iter().filter(|said| said != "ok").collect();
                    let stop = match command.expects {
                        Some(WRITING) => Stop::NotWriting(command.text.clone(), said),
                        _ => Stop::NotWritten(said),
                    };
                    return Ok(Outcome { stop: Some(stop), ..outcome });
                }
                outcome.file_line = outcome.file_line.max(command.file_line);
                sending.watch.sent(command.file_line, &command.text);
                number += 1;
            }
            Answer::NoText => {
                last_lines += 1;
                if last_lines > MOST_LAST_LINES {
                    return Err(SendError::Silent(vec![format!("(nothing after {LAST_LINE:?})")]));
                }
                // Repeated with the same number, the line might be answered by `ok` alone; it gets
                // a new number.
                source.closing = LAST.iter();
                sending.may_lack = sending.may_lack.saturating_add(1);
                number += 1;
            }
            Answer::Again(wanted) => {
                outcome.resends += 1;
                number = match sending.line_asked_for(wanted) {
                    Ok(number) => number,
                    Err(stop) => return Ok(Outcome { stop: Some(stop), ..outcome }),
                };
            }
            Answer::Stop(stop) => return Ok(Outcome { stop: Some(stop), ..outcome }),
        }
    }
}

#[cfg(test)]
mod conversations;
#[cfg(test)]
mod tests;
