//! Fetches a board's black box (M791).

use std::fmt;

use super::error::SendError;
use super::meeting::meet;
use super::packing::Packing;
use super::port::{Patience, Port};
use crate::black_box_lines::{Assembly, LinesError};

/// Reason why a black box was not fetched.
#[derive(Debug)]
pub enum FetchError {
    /// The conversation has failed.
    Send(SendError),
    /// The printer does not know M791: its firmware is older, or another one.
    Unknown,
    /// The printer refuses; its words.
    Refused(String),
    /// The lines are damaged or incomplete.
    Lines(LinesError),
}

impl fmt::Display for FetchError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Send(error) => error.fmt(out),
            Self::Unknown => out.write_str("this printer has no black box: its firmware does not know M791"),
            Self::Refused(words) => write!(out, "the printer does not send its black box: {words}"),
            Self::Lines(error) => error.fmt(out),
        }
    }
}

impl std::error::Error for FetchError {}

impl From<SendError> for FetchError {
    fn from(error: SendError) -> Self {
        Self::Send(error)
    }
}

impl From<std::io::Error> for FetchError {
    fn from(error: std::io::Error) -> Self {
        Self::Send(error.into())
    }
}

/// Fetches a board's black box and returns its bytes; `hear` receives the board's other lines.
///
/// # Errors
/// The board does not answer, has no black box or refuses to send it; or lines of it are missing.
pub fn fetch_black_box(
    port: &mut impl Port,
    patience: Patience,
    mut hear: impl FnMut(&str),
) -> Result<Vec<u8>, FetchError> {
    meet(port, Packing::Plain, patience, &mut |line: &str| hear(line))?;
    port.send(b"M791\n")?;
    let mut assembly = Assembly::default();
    let (mut refusal, mut is_answered) = (None, false);
    // Temperature reports may go on without end: only lines of the black box, its `ok` and busy
    // messages restart the time limit.
    let mut last = port.now();
    loop {
        let patience = if is_answered { patience.repeat } else { patience.give_up };
        if port.now().duration_since(last) >= patience {
            return Err(match (is_answered, assembly.is_begun()) {
                (true, false) => FetchError::Unknown,
                (_, true) => FetchError::Lines(LinesError::Unfinished),
                (false, false) => FetchError::Send(SendError::Silent(vec!["(nothing after M791)".to_owned()])),
            });
        }
        let Some(said) = port.receive(last + patience)? else { continue };
        match assembly.take(&said).map_err(FetchError::Lines)? {
            Some(true) => return Ok(assembly.into_bytes()),
            Some(false) => last = port.now(),
            None if said.contains("Unknown command") => refusal = Some(FetchError::Unknown),
            // Only M791 can be refused now: no other line is unanswered.
            None if said.starts_with("echo:line ") => refusal = Some(FetchError::Refused(said)),
            None if said.starts_with("ok") => match refusal.take() {
                Some(refusal) => return Err(refusal),
                None => (is_answered, last) = (true, port.now()),
            },
            None if said.starts_with("echo:busy:") => last = port.now(),
            None => hear(&said),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::send::scripted::{Scripted, echo};

    fn fetched(answer: &[&'static str]) -> Result<Vec<u8>, String> {
        let mut port = Scripted::new(|line: &str, _| match line {
            "M791" => answer.iter().map(|&line| line.to_owned()).collect(),
            line => echo(line).unwrap_or_else(|| vec!["ok".to_owned()]),
        });
        fetch_black_box(&mut port, Patience::DEFAULT, |_| {}).map_err(|error| error.to_string())
    }

    #[test]
    fn lines_in_between_are_not_its() {
        let lines = [
            "ok",
            "T:20.0 /0.0 B:20.0 /0.0 @:0 B@:0",
            "blackbox:0:Rk",
            "blackbox:0:RkJY",
            "T:20.1",
            "blackbox:1:MQ==",
            "blackbox:end:2",
        ];
        assert_eq!(fetched(&[&lines[..2], &lines[3..]].concat()).unwrap(), b"FBX1");
        assert_eq!(fetched(&lines).unwrap_err(), "line 0 of the black box is damaged: fetch it again");
    }

    #[test]
    fn printers_without_one_are_named() {
        let none = "this printer has no black box: its firmware does not know M791";
        assert_eq!(fetched(&["echo:Unknown command: \"M791\"", "ok"]).unwrap_err(), none);
        assert_eq!(fetched(&["ok", "T:20.0 /0.0"]).unwrap_err(), none);
        let refused = "echo:line 3: this board has no black box";
        let expected = format!("the printer does not send its black box: {refused}");
        assert_eq!(fetched(&[refused, "ok"]).unwrap_err(), expected);
        assert_eq!(fetched(&["ok", "blackbox:0:RkJY"]).unwrap_err(), "the black box breaks off: fetch it again");
        assert!(fetched(&[]).unwrap_err().starts_with("the board does not answer"));
    }
}
