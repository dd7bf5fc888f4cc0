//! Queries a printer of any firmware.

use std::fmt;
use std::time::Duration;

use super::error::SendError;
use super::meeting::{Met, meet};
use super::packing::Packing;
use super::port::{HALTED, Patience, Port};
use super::watch::Watch;

/// Start of the line that a printer sends every two seconds while it is busy.
const BUSY: &str = "echo:busy:";

/// Number of such lines after which the printer counts as busy.
const MAX_BUSY: usize = 30;

/// Maximum time and maximum number of lines of a whole answer.
const MAX_TIME: Duration = Duration::from_secs(120);
const MAX_LINES: usize = 5000;

/// Reason why a printer has not answered.
#[derive(Debug)]
pub enum AskError {
    /// The conversation has failed.
    Send(SendError),
    /// The printer is busy; its words.
    Busy(String),
    /// The answer to a command has no end.
    Endless(String),
}

impl fmt::Display for AskError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Send(error @ SendError::Silent(_)) => {
                write!(out, "{error}\nis it the printer's port, and its speed? --baud sets another, for example 250000")
            }
            Self::Send(error) => error.fmt(out),
            Self::Busy(words) => {
                write!(out, "the printer is busy ({words}): ask again when it neither heats nor moves")
            }
            Self::Endless(command) => {
                write!(out, "the answer to {command} has no end: stop what else the printer reports, and ask again")
            }
        }
    }
}

impl std::error::Error for AskError {}

impl<E: Into<SendError>> From<E> for AskError {
    fn from(error: E) -> Self {
        Self::Send(error.into())
    }
}

/// Counts the lines by which the printer says that it is busy.
#[derive(Default)]
struct BusyWatch {
    signs: usize,
    words: String,
}

impl Watch for BusyWatch {
    fn hear(&mut self, line: &str) {
        if let Some(words) = line.strip_prefix(BUSY) {
            self.signs += 1;
            self.words = crate::printable::one_line(words.trim()).into_owned();
        }
    }

    fn wants_end(&mut self) -> bool {
        self.signs >= MAX_BUSY
    }
}

/// Sends commands to a printer one after the other; returns the lines of each answer, including the
/// text after its `ok`.
///
/// # Errors
/// The printer does not answer, is busy or halted, or is gone.
pub fn ask(port: &mut impl Port, patience: Patience, commands: &[&str]) -> Result<Vec<Vec<String>>, AskError> {
    let mut watch = BusyWatch::default();
    if meet(port, Packing::Plain, patience, &mut watch)? == Met::EndWanted {
        return Err(AskError::Busy(watch.words));
    }
    let mut answers = Vec::new();
    for command in commands {
        port.send(format!("{command}\n").as_bytes())?;
        let begin = port.now();
        let mut answer: Vec<String> = Vec::new();
        loop {
            let now = port.now();
            if now.duration_since(begin) > MAX_TIME || answer.len() > MAX_LINES {
                return Err(AskError::Endless((*command).to_owned()));
            }
            let Some(said) = port.receive(now + patience.give_up)? else {
                return Err(SendError::Silent(vec![format!("(nothing more after {command})")]).into());
            };
            watch.hear(&said);
            if watch.wants_end() {
                return Err(AskError::Busy(watch.words));
            }
            if said.starts_with(HALTED) {
                return Err(SendError::Halted(said).into());
            }
            match said.strip_prefix("ok").filter(|rest| rest.is_empty() || rest.starts_with(' ')) {
                Some(rest) => {
                    answer.extend(Some(rest.trim().to_owned()).filter(|rest| !rest.is_empty()));
                    break;
                }
                None => answer.push(said),
            }
        }
        answers.push(answer);
    }
    Ok(answers)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::send::scripted::{Scripted, echo};

    fn asked(answer: impl Fn(&str) -> Vec<&'static str>) -> Result<Vec<Vec<String>>, String> {
        let mut port = Scripted::new(|line: &str, _| match line {
            "M115" | "M503" => answer(line).into_iter().map(str::to_owned).collect(),
            line => echo(line).unwrap_or_else(|| vec!["ok".to_owned()]),
        });
        ask(&mut port, Patience::DEFAULT, &["M115", "M503"]).map_err(|error| error.to_string())
    }

    #[test]
    fn each_command_has_its_answer() {
        let answers = asked(|line| match line {
            "M115" => vec!["ok FIRMWARE_NAME:Klipper"],
            _ => vec!["echo:busy: processing", "echo:  M92 X80.00", "oks", "ok P15 B3"],
        });
        let expected =
            [vec!["FIRMWARE_NAME:Klipper"], vec!["echo:busy: processing", "echo:  M92 X80.00", "oks", "P15 B3"]];
        assert_eq!(answers.unwrap(), expected);
    }

    #[test]
    fn printers_that_do_not_come_to_an_end_are_left() {
        let silent = asked(|line| if line == "M115" { vec!["ok"] } else { vec!["echo:  M92 X80.00"] }).unwrap_err();
        assert!(silent.contains("(nothing more after M503)") && silent.contains("--baud"), "{silent}");
        let busy = asked(|_| vec!["echo:busy: processing"; 40]).unwrap_err();
        assert!(busy.starts_with("the printer is busy (processing): ask again"), "{busy}");
        let endless = asked(|_| vec!["T:20.0 /0.0"; MAX_LINES + 2]).unwrap_err();
        assert!(endless.starts_with("the answer to M115 has no end"), "{endless}");
        let halted = asked(|_| vec!["Error:Printer halted. kill() called!"]).unwrap_err();
        assert!(halted.contains("halted"), "{halted}");
        let mut port = Scripted::new(|_: &str, _| vec!["echo:busy: processing"; 40]);
        let busy = ask(&mut port, Patience::DEFAULT, &["M115"]);
        assert!(matches!(busy, Err(AskError::Busy(words)) if words == "processing"));
    }
}
