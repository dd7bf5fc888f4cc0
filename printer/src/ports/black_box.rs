//! The black box, which records commands as they begin.

use core::fmt;

/// Memory of the last seconds that survives a reset. Machines may do without.
pub trait BlackBox: fmt::Debug {
    /// A command begins: its line, and its text without comment.
    fn command(&self, line: u32, text: &str);
    /// Requests it for the host that is answered. Its owner sends it when the line has had its
    /// `ok`, and motion has ended.
    fn send(&self);
    /// Erases all records.
    fn clear(&self);
}
