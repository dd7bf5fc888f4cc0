//! M20 to M34, M413, M524, M928, M1000, with Marlin's texts.

use ferrostep_card::{Answer, CardFailure, ListFrom, ListOptions, LongPath, OpenedFile, Request};
use ferrostep_gcode::{CardCommand, Command, Reply};
use ferrostep_hal_shim::card::CardError;

use crate::error::CommandError;
use crate::job::card::{Job, Selected, Writing, is_a};
use crate::job::lines::Source;
use crate::job::paused::PauseReason;
use crate::ports::{Heating, Ports, Replies};
use crate::printer::Printer;

impl<P: Ports> Printer<'_, P> {
    /// Mounts a card at startup, as M21 does.
    pub async fn mount_card(&mut self) {
        let mounted = self.ask_card(Request::Mount).await;
        match mounted {
            Ok(_) => {
                self.replies.send(Reply::Text("echo:SD card ok"));
                self.find_interrupted_print().await;
            }
            Err(CardFailure::Slot(CardError::Missing)) => self.replies.send(Reply::Text("echo:No SD card")),
            Err(failure) => {
                self.replies.send(Reply::Text("Warning:volume.init failed"));
                self.replies.say(format_args!("echo:card: {failure}"));
            }
        }
    }

    /// Executes a command for the card.
    pub(crate) async fn card_command(&mut self, command: CardCommand<'_>) -> Result<(), CommandError> {
        match command {
            CardCommand::List { long, time } => self.list_card(ListOptions { long, time }).await,
            CardCommand::Mount => self.mount_unless_printing().await?,
            CardCommand::Release => self.release_card().await?,
            CardCommand::Select(path) => {
                self.select_file(path).await?;
            }
            CardCommand::Start { position } => self.start_print(position).await?,
            CardCommand::Pause => self.pause_by_host().await?,
            CardCommand::SetPosition(position) => self.set_print_position(position)?,
            CardCommand::ReportProgress => self.report_progress(),
            CardCommand::ReportFile => self.report_file(),
            CardCommand::AutoReport { seconds } => self.signals.set_card_report_interval_s(seconds),
            CardCommand::Write(path) => self.begin_write(path, Writing::File).await?,
            CardCommand::Log(path) => self.begin_write(path, Writing::Log).await?,
            CardCommand::EndWrite => self.end_write().await,
            CardCommand::Delete(path) => self.delete_file(path).await?,
            CardCommand::ReportTime => self.report_print_time(),
            CardCommand::SelectAndStart { path, position } => {
                if self.select_file(path).await? {
                    self.start_print(position).await?;
                }
            }
            CardCommand::ReportLongPath(path) => self.report_long_path(path).await,
            CardCommand::Sort => {}
            CardCommand::Abort => self.abort_print(),
            CardCommand::KeepPlace(on) => self.keep_prints(on).await,
            CardCommand::Interrupted(command) => self.interrupted_print(command).await?,
        }
        Ok(())
    }

    /// Refuses a command that would take away the file that is being printed or written.
    fn unless_in_use(&self) -> Result<(), CommandError> {
        if self.print.card.job == Job::Printing || self.print.card.writing != Writing::Not {
            return Err(CommandError::CardInUse);
        }
        Ok(())
    }

    async fn mount_unless_printing(&mut self) -> Result<(), CommandError> {
        self.unless_in_use()?;
        self.mount_card().await;
        Ok(())
    }

    async fn list_card(&mut self, options: ListOptions) {
        let mut from = ListFrom::Start;
        loop {
            let page = self.ask_card(Request::List(options, from)).await;
            if from == ListFrom::Start {
                match page {
                    // Without a card the list is one line.
                    Err(CardFailure::Slot(_) | CardFailure::NotMounted) => {
                        return self.replies.send(Reply::Text("echo:No media"));
                    }
                    _ => self.replies.send(Reply::Text("Begin file list")),
                }
            }
            if let Err(failure) = page {
                self.replies.say(format_args!("echo:card: {failure}"));
            } else if let Some(port) = self.print.card.port {
                let replies = self.replies;
                port.with(&mut |mailbox| mailbox.page().lines().for_each(|line| replies.send(Reply::Text(line))));
            }
            if !matches!(page, Ok(Answer::Page { more: true })) {
                return self.replies.send(Reply::Text("End file list"));
            }
            from = ListFrom::Next;
        }
    }

    async fn release_card(&mut self) -> Result<(), CommandError> {
        self.unless_in_use()?;
        // The file of a paused print stays selected.
        if self.print.card.job == Job::None {
            self.print.card.selected = None;
        }
        let _ = self.ask_card(Request::Release).await;
        self.replies.send(Reply::Text("echo:SD card released"));
        Ok(())
    }

    /// Selects a file. Returns true if that succeeded.
    async fn select_file(&mut self, path: &str) -> Result<bool, CommandError> {
        self.unless_in_use()?;
        if self.print.card.job == Job::Paused {
            return Err(CommandError::CardInUse);
        }
        let mut opened = self.open_file(path).await;
        // Some slicers write a time after the name.
        if let (Err(CardFailure::NotFound), Some((name, _))) = (&opened, path.split_once(' ')) {
            opened = self.open_file(name).await;
        }
        let selected = match opened {
            Ok(selected) => selected,
            Err(failure) => {
                self.refuse_file("open failed", path, failure);
                return Ok(false);
            }
        };
        self.replies.say(format_args!("echo:Now fresh file: {path}"));
        let replies = self.replies;
        self.with_opened(|file| {
            replies.say(format_args!("File opened: {} Size: {}", file_name(&file.short), file.size));
        });
        self.replies.send(Reply::Text("File selected"));
        (self.print.card.position, self.print.card.seek, self.print.card.selected) = (0, None, Some(selected));
        Ok(true)
    }

    async fn open_file(&mut self, path: &str) -> Result<Selected, CardFailure> {
        self.ask_card(Request::Open(LongPath::try_from(path).map_err(|_| CardFailure::NotFound)?)).await?;
        if self.with_opened(|file| is_a(file, ".BGC", ".bgcode")) == Some(true) {
            return Err(CardFailure::BinaryGcode);
        }
        self.with_opened(|file| Selected::from(file)).ok_or(CardFailure::NotFound)
    }

    /// Calls `look` with the open file, if any.
    pub(crate) fn with_opened<T>(&self, look: impl Fn(&OpenedFile) -> T) -> Option<T> {
        let mut seen = None;
        self.print.card.port?.with(&mut |mailbox| seen = mailbox.opened().map(&look));
        seen
    }

    /// Reports Marlin's text for a failure with a file, and the reason.
    pub(super) fn refuse_file(&self, what: &str, path: &str, failure: CardFailure) {
        self.replies.say(format_args!("{what}, File: {path}."));
        self.replies.say(format_args!("echo:card: {failure}"));
    }

    /// M24: resumes a paused print, the host's or the card's, or begins one.
    pub(crate) async fn start_print(&mut self, position: Option<u32>) -> Result<(), CommandError> {
        if self.is_paused() && self.print.card.job == Job::None {
            return self.resume().await;
        }
        if self.print.card.selected.is_none() {
            self.replies.say(format_args!("echo:card: {}", CardFailure::NoFile));
            return Ok(());
        }
        if self.print.card.job == Job::Printing {
            return Ok(());
        }
        // The card may have been pulled out and put back.
        if let Err(failure) = self.ask_card(Request::Reopen).await {
            self.replies.say(format_args!("echo:card: {failure}; the print waits for M24"));
            return Ok(());
        }
        if let Some(position) = position {
            self.print.card.seek = Some((position, 0));
        }
        self.begin_keeping(self.print.card.job == Job::None).await;
        if self.is_paused() {
            self.resume().await?;
        } else if self.print.card.job == Job::Paused {
            self.replies.send(Reply::Text("//action:resumed"));
        } else {
            self.forget_rested_heaters();
            self.print.card.aborted = false;
        }
        self.set_card_job(Job::Printing);
        Ok(())
    }

    /// Executes M25: pauses a print from the card or a host and parks the nozzle.
    async fn pause_by_host(&mut self) -> Result<(), CommandError> {
        self.pause(PauseReason::Pause).await?;
        self.note_paused();
        Ok(())
    }

    /// Notes that a line has paused the print: reading the card stops here.
    pub(super) fn note_paused(&mut self) {
        if self.is_paused() && self.print.card.job == Job::Printing {
            self.set_card_job(Job::Paused);
        }
    }

    /// Pauses a print from the card that cannot continue here, as M25 does, with the nozzle parked.
    /// If even that fails, the nozzle stays where it is.
    pub(super) async fn pause_print(&mut self) {
        self.lines.source = Source::Card;
        // The failure has been reported already; a stop ends the print.
        let _ = self.command_with_signs_of_life(&Command::Card(CardCommand::Pause)).await;
        self.signals.set_at_work(self.is_paused());
        if self.print.card.job == Job::Printing {
            self.set_card_job(Job::Paused);
            self.replies.send(Reply::Text("//action:paused"));
        }
    }

    /// M26.
    fn set_print_position(&mut self, position: u32) -> Result<(), CommandError> {
        if self.print.card.job == Job::Printing {
            return Err(CommandError::CardInUse);
        }
        if self.print.card.selected.is_some() {
            (self.print.card.seek, self.print.card.position) = (Some((position, 0)), position);
            self.note_card_progress();
        }
        Ok(())
    }

    /// M524.
    fn abort_print(&mut self) {
        if self.print.card.job != Job::None {
            self.print.card.aborted = true;
        }
    }

    /// Ends a print after M524: planned motion ends, and all heaters are switched off.
    pub(super) async fn end_aborted_print(&mut self) {
        self.heating.all_off();
        self.forget_rested_heaters();
        self.commanded_fans_off().await;
        self.replies.send(Reply::Text("//action:cancel"));
        self.replies.send(Reply::Text("echo:card: the print was ended, heaters and fans are off"));
    }

    fn report_progress(&self) {
        match &self.print.card.selected {
            Some(selected) => {
                self.replies.say(format_args!("SD printing byte {}/{}", self.print.card.position, selected.size));
            }
            None => self.replies.send(Reply::Text("Not SD printing")),
        }
    }

    fn report_file(&self) {
        let replies = self.replies;
        let told = self.with_opened(|file| {
            replies.say(format_args!("Current file: {} {}", file_name(&file.short), file_name(&file.long)));
        });
        if told.is_none() {
            self.replies.send(Reply::Text("Current file: (no file)"));
        }
    }

    async fn delete_file(&mut self, path: &str) -> Result<(), CommandError> {
        self.unless_in_use()?;
        if self.print.card.job == Job::Paused {
            return Err(CommandError::CardInUse);
        }
        // It may be the selected file.
        self.print.card.selected = None;
        let _ = self.ask_card(Request::Close).await;
        let deleted = match LongPath::try_from(path) {
            Ok(path) => self.ask_card(Request::Delete(path)).await,
            Err(_) => Err(CardFailure::NotFound),
        };
        match deleted {
            Ok(_) => self.replies.say(format_args!("File deleted:{path}")),
            Err(CardFailure::ReadOnly) => self.refuse_file("Deletion failed (read-only)", path, CardFailure::ReadOnly),
            Err(failure) => self.refuse_file("Deletion failed", path, failure),
        }
        Ok(())
    }

    async fn report_long_path(&mut self, path: &str) {
        let found = match LongPath::try_from(path) {
            Ok(path) => self.ask_card(Request::LongPath(path)).await,
            Err(_) => Err(CardFailure::NotFound),
        };
        match found {
            Ok(_) => {
                let replies = self.replies;
                if let Some(port) = self.print.card.port {
                    port.with(&mut |mailbox| replies.send(Reply::Text(mailbox.page())));
                }
            }
            Err(failure) => self.refuse_file("open failed", path, failure),
        }
    }
}

/// The file name at the end of a path.
fn file_name(path: &str) -> &str {
    path.rsplit_once('/').map_or(path, |(_, name)| name)
}
