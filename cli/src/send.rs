//! Sends a prepared job to a board.

use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::time::{Duration, Instant};

use ferrostep_gpre::transfer::{Report, Sender, Word};

/// Lines from the board that an error tells.
const REMEMBERED_LINES: usize = 6;

/// Commands with which a transfer begins, each answered by an `ok`.
const BEGINNING_COMMANDS: u32 = 2;

/// A board that answers the beginning so often, but with no report, takes no job; one answer may be that to a host before.
const MOST_UNHEEDED: u32 = 2;

/// What a board says to who begins a transfer in the middle of another.
const OTHER_JOB: &str = "echo:gpre: another job is being received";

/// How the line begins that a halted board says.
const HALTED: &str = "Error:Printer halted";

/// A line with a board at its other end.
pub trait Port {
    /// Sends bytes.
    ///
    /// # Errors
    /// The board is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// The next line from the board, without its end; `None` when none has come in time.
    ///
    /// # Errors
    /// The board is gone.
    fn receive(&mut self, until: Instant) -> io::Result<Option<String>>;

    /// The time, as patience counts it: the clock of this computer, but where the board's time is another.
    fn now(&mut self) -> Instant {
        Instant::now()
    }
}

/// How long to wait for what.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// The board says nothing though there is something to say: it is asked.
    pub ask: Duration,
    /// It has said nothing at all for so long: it is gone.
    pub give_up: Duration,
    /// The board waits so long for this host, s.
    pub board_s: u16,
}

impl Patience {
    /// For a board at a line.
    pub const DEFAULT: Self = Self { ask: Duration::from_millis(250), give_up: Duration::from_secs(20), board_s: 30 };
}

/// Why a job was not sent to its end.
#[derive(Debug)]
pub enum SendError {
    /// The board is gone.
    Port(io::Error),
    /// The board says nothing; the last lines that it said.
    Silent(Vec<String>),
    /// It answers, but does not take the job: it knows of none, or is halted, or receives another one; the last lines that
    /// it said.
    NotTaken(Vec<String>),
    /// It has halted while it was sent G-code; the line that says so.
    Halted(String),
}

impl fmt::Display for SendError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(error) => write!(out, "the line to the board broke: {error}"),
            Self::Silent(heard) => write_heard(out, "the board does not answer", heard),
            Self::NotTaken(heard) => write_heard(out, "the board does not take the job", heard),
            Self::Halted(line) => write!(out, "the board has halted: {line}"),
        }
    }
}

/// What is wrong, and what the board has said.
fn write_heard(out: &mut fmt::Formatter<'_>, what: &str, heard: &[String]) -> fmt::Result {
    write!(out, "{what}")?;
    if !heard.is_empty() {
        write!(out, "; the last it said:")?;
    }
    heard.iter().try_for_each(|line| write!(out, "\n  {line}"))
}

impl std::error::Error for SendError {}

impl From<io::Error> for SendError {
    fn from(error: io::Error) -> Self {
        Self::Port(error)
    }
}

/// A numbered line with its checksum.
fn numbered(number: u32, text: &str) -> String {
    let line = format!("N{number} {text}");
    let sum = line.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("{line}*{sum}\n")
}

/// Sends a job and waits until the board has executed it, or stops. What the board says beside its reports goes to `hear`.
///
/// A board that is in the middle of the same job, because its host was restarted, goes on with it.
///
/// # Errors
/// The board does not answer, or takes no job, or is gone. That it refuses the job, or stops, is a report.
pub fn send(
    port: &mut impl Port,
    sender: &mut Sender,
    patience: Patience,
    mut look: impl FnMut(&Sender),
    mut hear: impl FnMut(&str),
) -> Result<Report, SendError> {
    let mut heard = VecDeque::new();
    // The line end is that of a frame which a host before this one has not sent to its end.
    let begin = format!("\n{}{}", numbered(0, "M110 N0"), numbered(1, &sender.command(patience.board_s)));
    port.send(begin.as_bytes())?;
    let mut asked = port.now();
    let mut last = asked;
    // How often the board has accepted a command since the transfer was last begun, and how often all in vain.
    let (mut accepted, mut unheeded) = (0, 0);
    loop {
        while let Some(frame) = sender.next_frame() {
            port.send(&frame)?;
            asked = port.now();
        }
        let wait = if sender.awaits_answer() { patience.ask } else { patience.ask * 8 };
        if let Some(line) = port.receive(asked + wait)? {
            last = port.now();
            // What is reported before the board has accepted the beginning was for a host before this one.
            let reports = sender.has_begun() || accepted >= BEGINNING_COMMANDS;
            let is_report = if reports { sender.hear(&line) } else { Report::parse(&line).is_some() };
            if !is_report {
                hear(&line);
                accepted += u32::from(line.starts_with("ok"));
                if line.starts_with("Resend:") {
                    // Its `ok` says only that it waits for the line.
                    accepted = 0;
                }
            }
            if heard.len() == REMEMBERED_LINES {
                heard.pop_front();
            }
            heard.push_back(line);
            look(sender);
            if heard.back().is_some_and(|line| line.as_str() == OTHER_JOB) {
                return Err(SendError::NotTaken(heard.into()));
            }
            if let Some(end) = sender.end() {
                return Ok(end);
            }
        }
        let now = port.now();
        if now.duration_since(last) > patience.give_up {
            return Err(SendError::Silent(heard.into()));
        }
        if now.duration_since(asked) >= wait {
            if sender.has_begun() {
                port.send(&sender.question())?;
            } else {
                unheeded += u32::from(accepted >= BEGINNING_COMMANDS);
                if unheeded == MOST_UNHEEDED {
                    return Err(SendError::NotTaken(heard.into()));
                }
                accepted = 0;
                port.send(begin.as_bytes())?;
            }
            asked = now;
        }
    }
}

/// What a report says to a person.
pub fn describe(report: &Report) -> String {
    let [place, frame] = report.numbers;
    match report.word {
        Word::Done => "printed".to_owned(),
        Word::Refused => "the board refuses the job".to_owned(),
        Word::Stopped => format!("the board stopped in frame {frame} at byte {place}"),
        Word::None => "the board has forgotten the job: was it reset?".to_owned(),
        Word::Have | Word::Again => format!("the board has {place} bytes"),
    }
}

/// Sends G-code line by line, numbered and with check sums, again where the board asks for it, and waits for the end of its
/// motion. `next` is the next line of the file, its bytes. Returns how many lines were sent.
///
/// # Errors
/// The file cannot be read, the board does not answer, or has halted, or is gone.
pub fn send_lines(
    port: &mut impl Port,
    mut next: impl FnMut() -> Option<io::Result<Vec<u8>>>,
    patience: Patience,
    mut hear: impl FnMut(&str),
) -> Result<u32, SendError> {
    let mut count = 0;
    let mut ended = false;
    let mut line = numbered(0, "M110 N0");
    loop {
        port.send(line.as_bytes())?;
        let mut again = false;
        loop {
            let until = port.now() + patience.give_up;
            let Some(said) = port.receive(until)? else {
                return Err(SendError::Silent(vec![format!("(nothing after {:?})", line.trim_end())]));
            };
            hear(&said);
            // One line is on its way at a time, so it is that one.
            again |= said.starts_with("Resend:");
            if said.starts_with(HALTED) {
                return Err(SendError::Halted(said));
            }
            if said.starts_with("ok") {
                break;
            }
        }
        if again {
            continue;
        }
        if ended {
            return Ok(count);
        }
        let command = loop {
            match next() {
                None => break None,
                Some(text) => {
                    let text = text?;
                    // Comments may be in any code page; a command that is, is the board's to refuse.
                    let command = text.split(|&byte| byte == b';').next().unwrap_or_default();
                    let command = String::from_utf8_lossy(command).trim().to_owned();
                    if !command.is_empty() {
                        break Some(command);
                    }
                }
            }
        };
        ended = command.is_none();
        count += u32::from(!ended);
        line = numbered(count + u32::from(ended), command.as_deref().unwrap_or("M400"));
    }
}
