//! Whether the motors have passed the beginning of a line.

/// A line, and what became of it. Lines are counted upwards while one is watched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WatchedLine {
    /// None is watched.
    None,
    /// No move of this line or of one after it has been queued to its end.
    Ahead(u32),
    /// The first such move ends when this many slots have been played, modulo 2^32.
    Queued(u32),
}

impl WatchedLine {
    /// A move of a line has been queued to its end; `queued` slots have been filled so far.
    pub fn note(&mut self, line: u32, queued: u32) {
        if let Self::Ahead(watched) = *self
            && line >= watched
        {
            *self = Self::Queued(queued);
        }
    }

    /// Whether the motors have passed it, when `played` slots have been played.
    pub fn is_passed(&self, played: u32) -> bool {
        matches!(*self, Self::Queued(slot) if played.wrapping_sub(slot) as i32 >= 0)
    }
}
