//! The macros before and after a change of the tool: the profile's `tools.before_change` and
//! `tools.after_change`.
//!
//! Their lines replace the line that changes the tool, with that line between them, as those of a
//! macro replace its call. A profile's reader has checked that none of them changes the tool.

use core::fmt::Write;

use crate::job::macros::{Call, MacroLine};
use crate::part::Part;
use crate::ports::ToolsPart;

/// A change of the tool with its macros.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ChangeMacros {
    /// The new tool.
    pub(crate) tool: u8,
    /// The macro whose lines come next.
    pub(crate) call: Option<Call<'static>>,
    /// The line between the macros has been written.
    pub(crate) is_written: bool,
    pub(crate) has_ended: bool,
}

/// The changes with macros that one line of a host or a file causes; empty on a
/// machine with one tool.
pub(crate) type Changes<P> = <ToolsPart<P> as Part>::Of<Option<ChangeMacros>>;

/// The next step of a change.
pub(crate) enum NextOfChange {
    /// A line of the change.
    Line,
    /// The change has ended.
    Ended,
    /// No tool has changed.
    NoChange,
}

impl ChangeMacros {
    /// The line that changes the tool.
    pub(crate) fn write(&self, room: &mut MacroLine) {
        room.clear();
        let _ = write!(room, "T{}", self.tool);
    }
}
