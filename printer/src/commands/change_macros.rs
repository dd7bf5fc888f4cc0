//! The macros before and after a change of the tool, line by line.

use ferrostep_gcode::{Command, ParseError};

use crate::job::change_macros::{ChangeMacros, Changes, NextOfChange};
use crate::job::macros;
use crate::job::macros::{Call, MacroLine};
use crate::part::Part;
use crate::ports::{Ports, ToolsPart};
use crate::printer::Printer;
use crate::settings::profile::tools::MAX_TOOLS;

/// Words with which the macros are called, by the number of the new tool. A third tool would need
/// other words.
const WORDS: [&str; MAX_TOOLS] = ["FROM=1 TO=0", "FROM=0 TO=1"];

impl<P: Ports> Printer<'_, P> {
    /// State without a tool change so far.
    pub(crate) fn no_change() -> Changes<P> {
        ToolsPart::<P>::of(None)
    }

    /// Returns true during a change.
    pub(crate) fn is_changing(changes: &Changes<P>) -> bool {
        ToolsPart::<P>::get(changes).is_some_and(|change| change.as_ref().is_some_and(|change| !change.has_ended))
    }

    /// Begins a change if a command asks for one that has macros and can begin. If the tool is
    /// selected without moves (S1, or before all axes are homed), the macros, which move, are
    /// skipped as well.
    pub(crate) fn begins_change(&mut self, changes: &mut Changes<P>, command: &Command<'_>) -> bool {
        let Command::SelectTool { tool: Some(tool), stays: false } = *command else { return false };
        if !ToolsPart::<P>::PRESENT || Self::is_changing(changes) {
            return false;
        }
        let begun = self.change_with_macros(tool);
        self.lines.is_in_macro |= begun.is_some();
        let Some(change) = ToolsPart::<P>::get_mut(changes) else { return false };
        *change = begun;
        begun.is_some()
    }

    /// The change to a tool, if it has macros and can begin.
    #[inline(never)]
    fn change_with_macros(&self, number: u32) -> Option<ChangeMacros> {
        let tool = u8::try_from(number).ok()?;
        let change = &self.further_tools()?.change;
        let moves = self.interpreter.modal.homed == [true; 3];
        let has_macros = change.before.or(change.after).is_some();
        if !moves || !has_macros || tool == self.selected_tool() || self.may_change(tool).is_err() {
            return None;
        }
        Some(ChangeMacros { tool, call: self.call_at_change(change.before, tool), is_written: false, has_ended: false })
    }

    fn call_at_change(&self, name: Option<&'static str>, tool: u8) -> Option<Call<'static>> {
        let words = WORDS.get(usize::from(tool)).copied().unwrap_or_default();
        Some(macros::call(self.profile.macros, name?)?.with(words))
    }

    /// Writes the next line of a change.
    ///
    /// # Errors
    /// The macro's line becomes too long.
    pub(crate) fn next_of_change(
        &self,
        changes: &mut Changes<P>,
        room: &mut MacroLine,
    ) -> Result<NextOfChange, ParseError> {
        match ToolsPart::<P>::get_mut(changes) {
            Some(Some(change)) if ToolsPart::<P>::PRESENT => self.next_line_of_change(change, room),
            _ => Ok(NextOfChange::NoChange),
        }
    }

    #[inline(never)]
    fn next_line_of_change(&self, change: &mut ChangeMacros, room: &mut MacroLine) -> Result<NextOfChange, ParseError> {
        if let Some(call) = &mut change.call {
            if call.next_line(room)? {
                return Ok(NextOfChange::Line);
            }
            change.call = None;
        }
        if change.is_written {
            change.has_ended = true;
            return Ok(NextOfChange::Ended);
        }
        change.is_written = true;
        if let Some(tools) = self.further_tools() {
            change.call = self.call_at_change(tools.change.after, change.tool);
        }
        change.write(room);
        Ok(NextOfChange::Line)
    }

    /// Reports the line of a change's macro after a failure within it, and the selected tool.
    /// `room` then holds the line that changes the tool.
    pub(crate) fn tell_failed_change(&self, line: u32, changes: &Changes<P>, room: &mut MacroLine) {
        if !Self::is_changing(changes) {
            return;
        }
        let Some(Some(change)) = ToolsPart::<P>::get(changes) else { return };
        if let Some(call) = &change.call {
            self.tell_macro_end(line, call, room);
        }
        self.report_tool();
        change.write(room);
    }
}
