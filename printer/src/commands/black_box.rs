//! M791: sends the black box at rest.

use crate::error::CommandError;
use crate::ports::Ports;
use crate::ports::black_box::BlackBox;
use crate::printer::Printer;

impl<'a, P: Ports> Printer<'a, P> {
    /// Gives the machine a black box.
    pub fn set_black_box(&mut self, black_box: &'a dyn BlackBox) {
        self.fitted.black_box = Some(black_box);
    }

    pub(crate) fn send_black_box(&mut self, clear: bool) -> Result<(), CommandError> {
        let black_box = self.fitted.black_box.ok_or(CommandError::NotEquipped("black box"))?;
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
