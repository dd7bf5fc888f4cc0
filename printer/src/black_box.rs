//! M791: the black box, which records commands as they begin and is sent at rest.

use core::fmt;

use crate::error::CommandError;
use crate::ports::Ports;
use crate::printer::Printer;

/// What remembers the last seconds over a reset. Machines may do without.
pub trait BlackBox: fmt::Debug {
    /// A command begins: its line, and its text without comment.
    fn command(&self, line: u32, text: &str);
    /// The host that is answered wants it. Whoever owns it sends it when the line has had its `ok`, and motion has ended.
    fn send(&self);
    /// Forgets everything.
    fn clear(&self);
}

impl<'a, P: Ports> Printer<'a, P> {
    /// The machine has a black box.
    pub fn set_black_box(&mut self, black_box: &'a dyn BlackBox) {
        self.black_box = Some(black_box);
    }

    pub(crate) fn send_black_box(&mut self, clear: bool) -> Result<(), CommandError> {
        let black_box = self.black_box.ok_or(CommandError::NotEquipped("black box"))?;
        if self.interpreter.modal.in_prepared_job || self.prints_from_card() || self.is_paused() {
            return Err(CommandError::BlackBoxInPrint);
        }
        if clear {
            black_box.clear();
        } else {
            black_box.send();
        }
        Ok(())
    }
}
