//! The replies of a printer that executes a file.

use std::cell::RefCell;
use std::collections::BTreeSet;

use ferrostep_gcode::{Remarks, Reply};
use ferrostep_printer::{Failure, Replies};

use crate::command_code::code;
use crate::remarks::{RemarkKind, RemarkList};

/// Maximum number of unknown commands remembered; a broken file could name any number.
const MAX_UNKNOWN_COMMANDS: usize = 100;

/// Replies of a job from a file: lines for a person, and entries of the summary.
pub struct JobReplies<'a> {
    unknown: RefCell<BTreeSet<String>>,
    remarks: RemarkList,
    notice: Box<dyn Fn(&str) + 'a>,
}

impl<'a> JobReplies<'a> {
    /// Sends each line that a person should read to `notice`.
    pub fn new(notice: impl Fn(&str) + 'a) -> Self {
        Self { unknown: RefCell::default(), remarks: RemarkList::default(), notice: Box::new(notice) }
    }

    /// The different unknown commands so far, in alphabetical order.
    pub fn unknown_commands(&self) -> Vec<String> {
        self.unknown.borrow().iter().cloned().collect()
    }

    /// The remarks on the job's lines so far.
    pub fn remarks(&self) -> &RemarkList {
        &self.remarks
    }
}

impl Replies for JobReplies<'_> {
    fn send(&self, reply: Reply<'_>) {
        match reply {
            Reply::Text(text) => (self.notice)(text),
            Reply::Killed => (self.notice)(&reply.to_string()),
            // Replies to a host's questions; a file asks none.
            _ => {}
        }
    }

    /// The summary lists it.
    fn remark(&self, line: u32, text: &str, remarks: &Remarks, _: &Remarks) {
        let kind = match (remarks.is_unknown(), remarks.is_not_executed()) {
            (true, _) => RemarkKind::Unknown,
            (false, true) => RemarkKind::NoEffect,
            (false, false) if remarks.is_corner_limits_alone() => RemarkKind::Corner,
            (false, false) if remarks.is_no_effect_alone() && is_corner_limit(text) => RemarkKind::Corner,
            (false, false) => RemarkKind::Ignored,
        };
        self.remarks.note(kind, Some(line), format_args!("{}: {remarks}", code(text)));
    }

    fn note(&self, line: u32, text: std::fmt::Arguments<'_>) {
        self.remarks.note(RemarkKind::Ignored, Some(line), text);
    }

    fn unknown(&self, line: u32, text: &str) {
        if ferrostep_gcode::NotExecuted::of(text).is_none() {
            self.remarks.note(RemarkKind::Unknown, Some(line), format_args!("{}: unknown command", code(text)));
        }
        let mut unknown = self.unknown.borrow_mut();
        if unknown.len() < MAX_UNKNOWN_COMMANDS && !unknown.contains(text) {
            unknown.insert(text.to_owned());
            (self.notice)(&Reply::UnknownCommand(text).to_string());
        }
    }

    /// The job stops there, and reports it itself.
    fn refuse(&self, _line: u32, _failure: &Failure) {}
}

/// Returns true if a line is M205.
fn is_corner_limit(text: &str) -> bool {
    matches!(ferrostep_gcode::parse(text), Ok(ferrostep_gcode::Command::Junction { .. }))
}
