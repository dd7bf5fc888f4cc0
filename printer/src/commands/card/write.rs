//! Host lines that are written to a file: M28, M29, M928.

use embedded_hal_async::delay::DelayNs;
use ferrostep_card::{CardFailure, LongPath, Put, Request};
use ferrostep_gcode::Reply;

use super::task::LOOK_MS;
use crate::commands::host::is_end_of_file;
use crate::error::CommandError;
use crate::job::card::{Job, Writing};
use crate::ports::{Ports, Replies};
use crate::printer::Printer;

impl<P: Ports> Printer<'_, P> {
    /// Returns, once, whether the last command has begun to write its host's lines into a file.
    pub(crate) fn take_begun_writing(&mut self) -> bool {
        core::mem::take(&mut self.print.card.begun_writing)
    }

    /// M28, M928.
    pub(super) async fn begin_write(&mut self, path: &str, writing: Writing) -> Result<(), CommandError> {
        if self.print.card.job != Job::None || self.print.card.writing != Writing::Not {
            return Err(CommandError::CardInUse);
        }
        self.print.card.selected = None;
        let created = match LongPath::try_from(path) {
            Ok(path) => self.ask_card(Request::Create(path)).await,
            Err(_) => Err(CardFailure::BadName),
        };
        if let Err(failure) = created {
            self.refuse_file("open failed", path, failure);
            return Ok(());
        }
        self.replies.say(format_args!("echo:Now fresh file: {path}"));
        self.replies.say(format_args!("Writing to file: {path}"));
        (self.print.card.writing, self.print.card.begun_writing) = (writing, writing == Writing::File);
        self.signals.set_writing(writing == Writing::File);
        Ok(())
    }

    /// M29.
    pub(super) async fn end_write(&mut self) {
        let writing = core::mem::replace(&mut self.print.card.writing, Writing::Not);
        self.signals.set_writing(false);
        if writing == Writing::Not {
            return;
        }
        let finished = self.ask_card(Request::Finish).await;
        match finished {
            Ok(_) if writing != Writing::Lost => self.replies.send(Reply::Text("Done saving file.")),
            Ok(_) => self.replies.send(Reply::Text("echo:card: the file is incomplete, delete it with M30")),
            Err(failure) => self.tell_write_error(failure),
        }
    }

    /// Writes a line of the host; `false` if it was the last one.
    pub(crate) async fn write_line(&mut self, text: &str) -> bool {
        self.signals.note_host();
        if is_end_of_file(text) {
            self.end_write().await;
        } else if self.print.card.writing == Writing::File
            && let Err(failure) = self.put_line(text).await
        {
            self.tell_write_error(failure);
            // The following lines are part of the file and must not be executed.
            self.print.card.writing = Writing::Lost;
        }
        self.replies.send(Reply::Ok);
        self.print.card.writing != Writing::Not
    }

    /// Writes a line that is also executed (M928).
    pub(crate) async fn log_line(&mut self, text: &str) {
        // M29 ends the log and is not written to it.
        if self.print.card.writing == Writing::Log
            && !is_end_of_file(text)
            && let Err(failure) = self.put_line(text).await
        {
            self.tell_write_error(failure);
            self.print.card.writing = Writing::Not;
        }
    }

    fn tell_write_error(&self, failure: CardFailure) {
        self.replies.send(Reply::Text("Error:error writing to file"));
        self.replies.say(format_args!("echo:card: {failure}"));
    }

    async fn put_line(&mut self, text: &str) -> Result<(), CardFailure> {
        for mut bytes in [text.as_bytes(), b"\n"] {
            while !bytes.is_empty() {
                let mut put = Put::Failed(CardFailure::NotMounted);
                if let Some(port) = self.print.card.port {
                    port.with(&mut |mailbox| put = mailbox.put(bytes));
                }
                match put {
                    Put::Bytes(length) => bytes = bytes.get(length..).unwrap_or_default(),
                    Put::Wait => self.clock.delay_ms(LOOK_MS).await,
                    Put::Failed(failure) => return Err(failure),
                }
            }
        }
        Ok(())
    }
}
