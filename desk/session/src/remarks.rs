//! Remarks on a job before it is printed: lines that have no effect here, or are executed
//! differently from their text, and findings of the rehearsal (moves before homing,
//! heaters left on ...).

use std::cell::RefCell;
use std::fmt;

use ferrostep_host::printable::one_line;
use serde::Serialize;

/// Maximum number of different remarks kept; a broken file could cause any number.
const MAX_REMARKS: usize = 100;
/// Maximum number of lines that a remark names.
const MAX_LINES: usize = 5;

/// The subject of a remark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RemarkKind {
    /// Limits at corners and of short moves (M205, SET_VELOCITY_LIMIT) that this machine takes from
    /// its profile: the part is the same, and `--strict` lets it pass.
    Corner,
    /// A command of limits that the firmware does not have or refuses by whose rules the job is
    /// planned; `--strict` lets it pass.
    Foreign,
    /// A command or word without effect on this machine.
    NoEffect,
    /// A word that is ignored or changed.
    Ignored,
    /// An unknown command.
    Unknown,
    /// A macro that the profile lacks and that is taken for the machine's start.
    Assumed,
    /// A target outside the travel.
    SoftLimit,
    /// A move of an axis that is not homed.
    NotHomed,
    /// A line at which the printer waits for a person, or is asked to.
    Pause,
    /// A flow of filament above the nozzle's melting rate.
    Flow,
    /// A heater that is still on at the end.
    HeaterOn,
    /// A file without a command.
    NoCommands,
}

impl RemarkKind {
    /// Returns true if the part is the same all the same, so that `--strict` lets it pass.
    pub const fn is_harmless(self) -> bool {
        matches!(self, Self::Corner | Self::Foreign)
    }
}

/// A remark.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Remark {
    /// Subject of the remark.
    pub kind: RemarkKind,
    /// Text of the remark, with the command.
    pub message: String,
    /// Number of its lines.
    pub count: u64,
    /// The first of these lines.
    pub lines: Vec<u32>,
}

/// The remarks about a job, in the order of their first lines.
#[derive(Debug, Default)]
pub struct RemarkList(RefCell<Vec<Remark>>);

impl RemarkList {
    /// Notes a remark; the same remark on another line is counted.
    pub fn note(&self, kind: RemarkKind, line: Option<u32>, message: impl fmt::Display) {
        let message = message.to_string();
        let mut list = self.0.borrow_mut();
        if let Some(same) = list.iter_mut().find(|remark| remark.kind == kind && remark.message == message) {
            same.count += 1;
            if same.lines.len() < MAX_LINES {
                same.lines.extend(line);
            }
        } else if list.len() < MAX_REMARKS {
            list.push(Remark { kind, message, count: 1, lines: line.into_iter().collect() });
        }
    }

    /// Returns all remarks.
    pub fn to_vec(&self) -> Vec<Remark> {
        self.0.borrow().clone()
    }
}

impl fmt::Display for Remark {
    /// The lines, then the text.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.lines[..] {
            [] => {}
            [only] if self.count == 1 => write!(out, "line {only}: ")?,
            [first, ..] => write!(out, "{} lines from {first} on: ", self.count)?,
        }
        out.write_str(&one_line(&self.message))
    }
}

/// Writes the remarks below a summary, a line each.
pub(crate) fn write_all(out: &mut fmt::Formatter<'_>, remarks: &[Remark]) -> fmt::Result {
    remarks.iter().try_for_each(|remark| writeln!(out, "  remark       {remark}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_remark_counts() {
        let list = RemarkList::default();
        for line in 3..20 {
            list.note(RemarkKind::Ignored, Some(line), "G1: F is not above 0 and is ignored");
        }
        list.note(RemarkKind::HeaterOn, None, "the bed is on");
        let list = list.to_vec();
        assert_eq!((list[0].count, &list[0].lines[..]), (17, &[3, 4, 5, 6, 7][..]));
        assert_eq!(list[0].to_string(), "17 lines from 3 on: G1: F is not above 0 and is ignored");
        assert_eq!(list[1].to_string(), "the bed is on");
        let many = RemarkList::default();
        (0..200).for_each(|line| many.note(RemarkKind::Unknown, Some(line), line));
        assert_eq!(many.to_vec().len(), MAX_REMARKS);
    }
}
