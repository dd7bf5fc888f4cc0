//! One serial line's side of the conversation: line numbers, checksums, one `ok` a line.

use ferrostep_gcode::{Line, LineError, LineNumbers, Reply, ResendReason, Verdict};

use crate::ports::{Ports, Replies};
use crate::printer::{Printer, Text};

/// A host on a serial line. Each line has its own numbers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Host {
    numbers: LineNumbers,
}

impl Host {
    /// A host that has said nothing yet.
    pub const fn new() -> Self {
        Self { numbers: LineNumbers::new() }
    }

    /// Answers what the line reader made of some bytes: executes a good line, `ok`s a repeated one, asks for a
    /// garbled one again.
    pub async fn answer<P: Ports>(&mut self, printer: &mut Printer<'_, P>, line: Result<Line<'_>, LineError>) {
        let replies = printer.replies();
        match line {
            Ok(line) => match self.numbers.check(&line) {
                Verdict::Execute => {
                    printer.set_last_line(self.numbers.last());
                    // The printer has already told the host.
                    let _ = printer.execute(line.line_number, line.text).await;
                }
                Verdict::Repeat => replies.send(Reply::Ok),
                Verdict::Resend(reason, last) => replies.send(Reply::Resend { reason, last }),
            },
            Err(error) => match self.numbers.check_unreadable(&error) {
                Some(Verdict::Resend(reason, last)) => replies.send(Reply::Resend { reason, last }),
                Some(_) => {
                    replies.send(Reply::Resend { reason: ResendReason::WrongChecksum, last: self.numbers.last() })
                }
                None => {
                    let mut text = Text::new();
                    if core::fmt::write(&mut text, format_args!("echo:line {}: {error}", error.line_number())).is_ok() {
                        replies.send(Reply::Text(&text));
                    }
                    replies.send(Reply::Ok);
                }
            },
        }
    }
}
