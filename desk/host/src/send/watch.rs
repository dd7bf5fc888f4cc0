//! Observes a conversation with a printer.

/// Observer of a conversation, which may also intervene in it.
pub trait Watch {
    /// Receives a line from the printer.
    fn hear(&mut self, line: &str);
    /// Called when a line of the file has been answered, with its number and command.
    fn sent(&mut self, _line: u32, _command: &str) {}
    /// Called when the printer asks its host to hold the job or to continue it.
    fn held(&mut self, _is_held: bool) {}
    /// Returns true if a person wants the job to end.
    fn wants_end(&mut self) -> bool {
        false
    }
    /// Returns a command that a person wants executed before the file's next one.
    fn command_between(&mut self) -> Option<String> {
        None
    }
    /// Returns true if a person wants to end the printer's wait, a pause or one for heat (M108).
    fn wants_wait_ended(&mut self) -> bool {
        false
    }
}

impl<F: FnMut(&str)> Watch for F {
    fn hear(&mut self, line: &str) {
        self(line);
    }
}
