//! Sends a prepared job or G-code to a board.

mod ask;
mod begin_packing;
mod black_box;
mod cool_down;
mod error;
mod lines;
mod meeting;
mod packing;
mod port;
mod protocol;
#[cfg(test)]
mod scripted;
mod watch;

pub use ask::{AskError, ask};
pub use begin_packing::begin_packing;
pub use black_box::{FetchError, fetch_black_box};
pub use cool_down::{CooledDown, cool_down};
pub use error::SendError;
pub use lines::{Frame, Outcome, Stop, send_lines};
pub use packing::Packing;
pub use port::{HALTED, Patience, Port};
pub use protocol::is_transfer_error;
pub use watch::Watch;

use std::collections::VecDeque;

use ferrostep_gpre::transfer::{Report, Sender, Word};

use meeting::meet;
use protocol::numbered;

/// Number of the board's last lines that an error includes.
const REMEMBERED_LINES: usize = 6;

/// Number of commands that open a transfer; the board answers each with an `ok`.
const BEGINNING_COMMANDS: u32 = 2;

/// Maximum number of attempts to open a transfer that the board answers with `ok` but without a
/// report. The first answer may be meant for an earlier host; after this many attempts the board is
/// taken not to know prepared jobs.
const MAX_UNREPORTED: u32 = 2;

/// Answer of a board that is asked to begin a transfer during another one.
const OTHER_JOB: &str = "echo:gpre: another job is being received";

/// Sends a job and waits until the board has executed or stopped it. `watch` hears the board's
/// lines that are not reports, and may end the job.
///
/// A board that is already in the middle of the same job, because the host restarted, continues it.
///
/// # Errors
/// The board does not answer, does not take the job, or is gone; or `watch` wants the end. A
/// refusal or a stop by the board is not an error but a [`Report`].
pub fn send(
    port: &mut impl Port,
    sender: &mut Sender,
    patience: Patience,
    mut look: impl FnMut(&Sender),
    mut watch: impl Watch,
) -> Result<Report, SendError> {
    let mut heard = VecDeque::new();
    meet(port, Packing::Plain, patience, &mut |line: &str| watch.hear(line))?;
    // The line end completes a frame that an earlier host left unfinished.
    let begin = format!("\n{}{}", numbered(0, "M110 N0"), numbered(1, &sender.command(patience.board_s)));
    port.send(begin.as_bytes())?;
    let mut asked = port.now();
    let mut last = asked;
    // Commands accepted since the transfer was last opened, and openings that the board accepted
    // without a report.
    let (mut accepted, mut unreported) = (0, 0);
    loop {
        if watch.wants_end() {
            abort(port, sender, patience)?;
            return Err(SendError::Asked);
        }
        while let Some(frame) = sender.next_frame() {
            port.send(&frame)?;
            asked = port.now();
        }
        let wait = if sender.awaits_answer() { patience.ask } else { patience.ask * 8 };
        let until = (asked + wait).min(port.now() + patience.look);
        if let Some(line) = port.receive(until)? {
            last = port.now();
            // A report before the board has accepted both commands belongs to an earlier host.
            let reports = sender.has_begun() || accepted >= BEGINNING_COMMANDS;
            let is_report = if reports { sender.hear(&line) } else { Report::parse(&line).is_some() };
            if !is_report {
                watch.hear(&line);
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

/// Aborts a transfer: stops the motion under way and waits until the board reports the end, after
/// which it executes lines again. Gives up on a board that reports nothing.
fn abort(port: &mut impl Port, sender: &mut Sender, patience: Patience) -> Result<(), SendError> {
    // M410 acts as soon as its bytes arrive; without it the board would first execute the moves
    // that it already has.
    port.send(&[&sender.abort()[..], b"\nM410\n"].concat())?;
    let until = port.now() + patience.give_up;
    while sender.end().is_none() {
        let Some(line) = port.receive(until)? else { break };
        sender.hear(&line);
    }
    Ok(())
}

/// Describes a report in words.
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
