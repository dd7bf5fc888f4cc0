//! Sends a prepared job, or G-code, to a board.

use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::time::{Duration, Instant};

use ferrostep_gpre::transfer::{Report, Sender, Word};

/// How many of the board's last lines an error repeats.
const REMEMBERED_LINES: usize = 6;

/// Commands that open a transfer, each answered by an `ok`.
const BEGINNING_COMMANDS: u32 = 2;

/// Attempts to open a transfer that the board answers with `ok` but without a report. The first answer may belong to an
/// earlier host; after this many the board does not know prepared jobs.
const MAX_UNREPORTED: u32 = 2;

/// The board's answer to a transfer that begins during another one.
const OTHER_JOB: &str = "echo:gpre: another job is being received";

/// Start of a halted board's line.
const HALTED: &str = "Error:Printer halted";

/// A line with a board at its other end.
pub trait Port {
    /// Sends bytes.
    ///
    /// # Errors
    /// The board is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// The next line from the board, without its line end; `None` if none arrives in time.
    ///
    /// # Errors
    /// The board is gone.
    fn receive(&mut self, until: Instant) -> io::Result<Option<String>>;

    /// The time that [`Patience`] is measured in: this computer's clock, except for a board in virtual time.
    fn now(&mut self) -> Instant {
        Instant::now()
    }
}

/// Time limits of a transfer.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// After this long without the expected answer the board is asked.
    pub ask: Duration,
    /// After this long without any line the board counts as gone.
    pub give_up: Duration,
    /// How long the board waits for this host, s.
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
    /// The board does not answer; its last lines.
    Silent(Vec<String>),
    /// The board answers but does not take the job: it does not know prepared jobs, is halted, or receives another one; its
    /// last lines.
    NotTaken(Vec<String>),
    /// The board halted while it received G-code; the line that says so.
    Halted(String),
}

impl fmt::Display for SendError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(error) => write!(out, "the connection to the board is lost: {error}"),
            Self::Silent(heard) => write_heard(out, "the board does not answer", heard),
            Self::NotTaken(heard) => write_heard(out, "the board does not take the job", heard),
            Self::Halted(line) => write!(out, "the board has halted: {line}"),
        }
    }
}

/// Writes what is wrong, and the board's last lines.
fn write_heard(out: &mut fmt::Formatter<'_>, what: &str, heard: &[String]) -> fmt::Result {
    write!(out, "{what}")?;
    if !heard.is_empty() {
        write!(out, "; its last lines:")?;
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

/// Sends a job and waits until the board has executed it, or stops. Lines of the board that are not reports go to `hear`.
///
/// A board that is already in the middle of the same job, because its host was restarted, continues it.
///
/// # Errors
/// The board does not answer, does not take the job, or is gone. A refusal or a stop by the board is not an error but a
/// [`Report`].
pub fn send(
    port: &mut impl Port,
    sender: &mut Sender,
    patience: Patience,
    mut look: impl FnMut(&Sender),
    mut hear: impl FnMut(&str),
) -> Result<Report, SendError> {
    let mut heard = VecDeque::new();
    // The line end completes a frame that an earlier host left unfinished.
    let begin = format!("\n{}{}", numbered(0, "M110 N0"), numbered(1, &sender.command(patience.board_s)));
    port.send(begin.as_bytes())?;
    let mut asked = port.now();
    let mut last = asked;
    // Commands accepted since the transfer was last opened; openings that were accepted without a report.
    let (mut accepted, mut unreported) = (0, 0);
    loop {
        while let Some(frame) = sender.next_frame() {
            port.send(&frame)?;
            asked = port.now();
        }
        let wait = if sender.awaits_answer() { patience.ask } else { patience.ask * 8 };
        if let Some(line) = port.receive(asked + wait)? {
            last = port.now();
            // A report before the board has accepted both commands belongs to an earlier host.
            let reports = sender.has_begun() || accepted >= BEGINNING_COMMANDS;
            let is_report = if reports { sender.hear(&line) } else { Report::parse(&line).is_some() };
            if !is_report {
                hear(&line);
                accepted += u32::from(line.starts_with("ok"));
                if line.starts_with("Resend:") {
                    // The `ok` after a resend request accepts nothing.
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
                unreported += u32::from(accepted >= BEGINNING_COMMANDS);
                if unreported == MAX_UNREPORTED {
                    return Err(SendError::NotTaken(heard.into()));
                }
                accepted = 0;
                port.send(begin.as_bytes())?;
            }
            asked = now;
        }
    }
}

/// A report in words.
pub fn describe(report: &Report) -> String {
    let [place, frame] = report.numbers;
    match report.word {
        Word::Done => "printed".to_owned(),
        Word::Refused => "the board refuses the job".to_owned(),
        Word::Stopped => format!("the board stopped in frame {frame} at byte {place}"),
        Word::None => "the board no longer knows the job: was it reset?".to_owned(),
        Word::Have | Word::Again => format!("the board has {place} bytes"),
    }
}

/// Sends G-code line by line with numbers and checksums, repeats lines that the board asks for, and waits for the end of the
/// motion. `next` returns the bytes of the file's next line. Returns the number of lines sent.
///
/// # Errors
/// The file cannot be read; the board does not answer, has halted, or is gone.
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
            // Only one line is under way at a time, so the request is for that one.
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
                    // Comments may be in any code page. A command with such bytes is sent, and the board refuses it.
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
