//! Observes a conversation with a printer.

/// Observes the lines that are sent.
pub trait Watch {
    /// The printer has sent a line.
    fn hear(&mut self, line: &str);
    /// A line of the file, with its command, has been answered.
    fn sent(&mut self, _line: u32, _command: &str) {}
    /// The printer wants its host to hold the job, or to continue.
    fn held(&mut self, _is_held: bool) {}
    /// Returns true if a person wants the job to end.
    fn wants_end(&mut self) -> bool {
        false
    }
    /// Returns a command that a person wants executed before the file's next one.
    fn command_between(&mut self) -> Option<String> {
        None
    }
    /// Returns true if a person wants the printer's wait to end: a pause, or one for heat (M108).
    fn wants_wait_ended(&mut self) -> bool {
        false
    }
}

impl<F: FnMut(&str)> Watch for F {
    fn hear(&mut self, line: &str) {
        self(line);
    }
}
