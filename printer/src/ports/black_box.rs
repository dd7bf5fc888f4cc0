//! The black box, which records commands as they begin.

use core::fmt;

/// Memory of the last seconds that survives a reset. Machines may do without.
pub trait BlackBox: fmt::Debug {
    /// A command begins: its line, and its text without comment.
    fn command(&self, line: u32, text: &str);
    /// The host that is answered wants it. Whoever owns it sends it when the line has had its `ok`,
    /// and motion has ended.
    fn send(&self);
    /// Forgets everything.
    fn clear(&self);
}
