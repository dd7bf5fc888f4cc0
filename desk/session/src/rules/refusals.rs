//! Commands of a file that the firmware whose rules hold does not have, or refuses.

use std::cell::RefCell;

use ferrostep_rules::Effect;

/// The effects of a line's commands on the limits, in words, until they are taken.
#[derive(Debug, Default)]
pub struct Refusals(RefCell<Vec<String>>);

impl Refusals {
    /// Notes what a firmware makes of a command.
    pub(super) fn note(&self, command: &str, firmware: &str, effect: Effect) {
        let reason = match effect {
            Effect::Changed => return,
            Effect::Unchanged => format!("its words change no limit of {firmware}"),
            Effect::Unknown => format!("{firmware} has no such command, and keeps its limits"),
            Effect::Refused => format!("{firmware} refuses it, and keeps its limits"),
        };
        self.0.borrow_mut().push(format!("{command}: {reason}"));
    }

    /// Takes the first one.
    pub fn take(&self) -> Option<String> {
        let mut waiting = self.0.borrow_mut();
        if waiting.is_empty() { None } else { Some(waiting.remove(0)) }
    }
}
