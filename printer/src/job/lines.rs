//! The lines: the one at hand, its source, and the remarks on those before it.

use ferrostep_gcode::Remarks;

/// The source of a line: it decides whether a person can be asked, and where a pause waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A host, which waits for the answer. The lines of a print have numbers; those that a person
    /// types have none.
    Host {
        /// The line has a number.
        is_numbered: bool,
    },
    /// A file that is read to its end: it has no person to ask.
    File,
    /// A card, while hosts are heard as well: its reader waits while [`crate::Printer::is_paused`].
    Card,
}

/// The line at hand, and what those before it have left.
#[derive(Debug)]
pub(crate) struct Lines {
    /// Number of the line being executed.
    pub number: u32,
    /// Source of the line at hand.
    pub source: Source,
    /// The command at hand is a line of a macro.
    pub is_in_macro: bool,
    /// Number of the host's last line.
    pub last: i64,
    /// Remarks made on this job's lines.
    pub said: Remarks,
    /// True once the hosts know that their prints end because the machine is halted.
    pub told_halted: bool,
}

impl Lines {
    /// No lines yet.
    pub const fn new() -> Self {
        Self { number: 0, source: Source::File, is_in_macro: false, last: 0, said: Remarks::NONE, told_halted: false }
    }

    /// A line begins.
    pub fn begin(&mut self, source: Source, number: u32) {
        (self.source, self.number) = (source, number);
    }

    /// Returns true if the line's source is a host, or a host is beside it.
    pub fn has_host(&self) -> bool {
        self.source != Source::File
    }
}
