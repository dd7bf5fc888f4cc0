//! The code that a line begins with, and what every code may do with the rest of its line.

use super::words::{Strays, Words};
use crate::remarks::{Remark, Remarks};
use crate::{Command, NotExecuted, Outcome, ParseError};

/// Code at the start of a line: `G29.1`, `M204`, `T0`.
#[derive(Clone, Copy)]
pub(super) struct Code<'a> {
    /// The number after the letter, `u32::MAX` if it is larger still.
    pub(super) number: u32,
    /// True if `.` and a subcode follow.
    pub(super) has_subcode: bool,
    /// The subcode, 0 without one.
    pub(super) subcode: u32,
    /// The whole line, trimmed.
    pub(super) text: &'a str,
    /// Text after the code.
    pub(super) rest: &'a str,
    /// `G` or `M`.
    pub(super) letter: u8,
}

impl<'a> Code<'a> {
    pub(super) fn unknown(&self) -> Command<'a> {
        Command::Unknown(self.text.trim_matches([' ', '\t']))
    }

    /// The rest of the line as text.
    pub(super) fn free_text(&self) -> &'a str {
        self.rest.trim_matches([' ', '\t'])
    }

    /// Reads what follows into an empty list of words.
    pub(super) fn words<'w, 'r>(&self, words: &'w mut Words<'r>) -> Result<&'w mut Words<'r>, ParseError> {
        words.read(self.rest, Strays::Remarked).map(|()| words)
    }

    /// The words of a command that moves something, or says where something is: a number without
    /// its letter is an error.
    pub(super) fn places<'w, 'r>(&self, words: &'w mut Words<'r>) -> Result<&'w mut Words<'r>, ParseError> {
        words.read(self.rest, Strays::Refused).map(|()| words)
    }

    /// Reads the text after the code into a separate list, for a command whose
    /// meaning depends on it.
    pub(super) fn peek<'r>(&self, remarks: &'r mut Remarks) -> Result<Words<'r>, ParseError> {
        Words::parse(self.rest, remarks, Strays::Remarked)
    }

    /// Treats a command that the parser has no code for.
    pub(super) fn not_executed(&self, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
        self.outcome(NotExecuted::find(self.letter, self.number), words.remarks())
    }

    /// Treats a command by its entry; without one it is unknown.
    pub(super) fn outcome(
        &self,
        entry: Option<(u8, &'static NotExecuted)>,
        remarks: &mut Remarks,
    ) -> Result<Command<'a>, ParseError> {
        let Some((index, entry)) = entry else { return Ok(self.unknown()) };
        remarks.add(Remark::NotExecuted(index));
        match entry.outcome {
            Outcome::Accepted => Ok(Command::Accepted),
            Outcome::Unknown => Ok(self.unknown()),
            Outcome::Refused => Err(ParseError::NotSupported { command: entry.name, why: entry.why }),
        }
    }

    /// Checks that what follows is well formed, for a command that has no words.
    pub(super) fn without_words(&self, command: Command<'a>, words: &mut Words<'_>) -> Result<Command<'a>, ParseError> {
        self.words(words).map(|_| command)
    }
}
