//! Commands for the card within a print's file: one list for files on a card and on the desk.

use ferrostep_gcode::{CardCommand, Command, Remark, Remarks};

use crate::error::CommandError;
use crate::job::lines::Source;
use crate::ports::Ports;
use crate::printer::{Answer, Printer};

/// The treatment of a command in the file of a print.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum InFile {
    /// The command is executed: it queries, pauses or ends the print.
    Works,
    /// The command selects, writes or deletes files; the print continues without executing it.
    HasNoEffect,
    /// The command is refused: the lines after it were not meant to be executed.
    IsRefused,
}

/// Treatment of a command in a print's file.
const fn in_file(command: &CardCommand<'_>) -> InFile {
    match command {
        CardCommand::List { .. }
        | CardCommand::Pause
        | CardCommand::ReportProgress
        | CardCommand::ReportFile
        | CardCommand::AutoReport { .. }
        | CardCommand::ReportTime
        | CardCommand::ReportLongPath(_)
        | CardCommand::Sort
        | CardCommand::Abort
        | CardCommand::KeepPlace(_) => InFile::Works,
        CardCommand::Mount
        | CardCommand::Release
        | CardCommand::Select(_)
        | CardCommand::Start { .. }
        | CardCommand::SetPosition(_)
        | CardCommand::EndWrite
        | CardCommand::Delete(_)
        | CardCommand::SelectAndStart { .. }
        | CardCommand::Interrupted(_)
        | CardCommand::Log(_) => InFile::HasNoEffect,
        CardCommand::Write(_) => InFile::IsRefused,
    }
}

impl<P: Ports> Printer<'_, P> {
    /// Adds the remarks on a card command in a file.
    pub(crate) fn add_card_remarks(&self, command: &CardCommand<'_>, remarks: &mut Remarks) {
        if self.source_is_host() {
            return;
        }
        match command {
            CardCommand::Start { .. } => remarks.add(Remark::NotPaused),
            CardCommand::Abort if self.lines.source == Source::File => remarks.add(Remark::EndsCardPrint),
            command if in_file(command) == InFile::HasNoEffect => remarks.add(Remark::NoFiles),
            _ => {}
        }
    }

    /// Returns `Ok` if a command of a file is to be executed; [`Answer::Given`] if it has no effect
    /// there.
    ///
    /// # Errors
    /// The command is not allowed in a print's file.
    pub(crate) fn may_stand_in_file(&self, command: &Command<'_>) -> Result<Answer, CommandError> {
        match command {
            Command::Card(card) if !self.source_is_host() => match in_file(card) {
                InFile::Works => Ok(Answer::Ok),
                InFile::HasNoEffect => Ok(Answer::Given),
                InFile::IsRefused => Err(CommandError::WritesWithinPrint),
            },
            _ => Ok(Answer::Ok),
        }
    }

    fn source_is_host(&self) -> bool {
        matches!(self.lines.source, Source::Host { .. })
    }
}
