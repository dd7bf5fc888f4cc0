//! One serial line's side of the conversation: line numbers, checksums, one `ok` per line.

use ferrostep_gcode::{CardCommand, Command, Line, LineError, LineNumbers, Reply, ResendReason, Verdict, parse};

use crate::ports::{Ports, Replies};
use crate::printer::Printer;

/// A host on a serial line. Each line has its own numbers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Host {
    numbers: LineNumbers,
    /// True while the host's lines are written to a file (M28).
    writes: bool,
    /// True if those lines have numbers; a line without one has lost it in transit.
    writes_numbered: bool,
}

impl Host {
    /// A host before its first byte.
    pub const fn new() -> Self {
        Self { numbers: LineNumbers::new(), writes: false, writes_numbered: false }
    }

    /// Answers a line reader's result: executes a good line, sends `ok` for a repeated one,
    /// requests a garbled one again.
    pub async fn answer<P: Ports>(&mut self, printer: &mut Printer<'_, P>, line: Result<Line<'_>, LineError>) {
        let replies = printer.replies();
        match line {
            Ok(line) => match self.numbers.check(&line) {
                Verdict::Execute => {
                    printer.set_last_line(self.numbers.last());
                    if self.writes {
                        let is_garbled = self.writes_numbered && line.number.is_none() && !is_end_of_file(line.text);
                        if is_garbled {
                            let (reason, last) = (ResendReason::WrongChecksum, self.numbers.last());
                            return replies.send(Reply::Resend { reason, last });
                        }
                        self.writes = printer.write_line(line.text).await;
                        return;
                    }
                    // The printer has answered the host already.
                    let _ = printer.execute_for_host(line.line_number, line.text, line.number.is_some()).await;
                    self.writes = printer.take_begun_writing();
                    self.writes_numbered = line.number.is_some();
                }
                Verdict::Repeat => replies.send(Reply::Ok),
                Verdict::Resend(reason, last) => replies.send(Reply::Resend { reason, last }),
            },
            Err(error) => match self.numbers.check_unreadable(&error) {
                Some(Verdict::Resend(reason, last)) => replies.send(Reply::Resend { reason, last }),
                Some(Verdict::Repeat) => replies.send(Reply::Ok),
                Some(Verdict::Execute) | None => {
                    replies.say(format_args!("echo:line {}: {error}", error.line_number()));
                    replies.send(Reply::Ok);
                }
            },
        }
    }
}

/// Returns true if a line is M29, which a person may send without a number.
pub(crate) fn is_end_of_file(text: &str) -> bool {
    matches!(parse(text), Ok(Command::Card(CardCommand::EndWrite)))
}
