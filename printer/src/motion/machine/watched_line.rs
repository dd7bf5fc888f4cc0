//! Watch on the motors' passing of the beginning of a line.

/// A line, and its progress in the queue. Lines are counted upwards while one is watched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WatchedLine {
    /// No line is watched.
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

    /// Returns true if the motors have passed it, when `played` slots have been played.
    pub fn is_passed(&self, played: u32) -> bool {
        matches!(*self, Self::Queued(slot) if played.wrapping_sub(slot) as i32 >= 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_passed_when_a_later_move_has_been_played() {
        let mut watched = WatchedLine::Ahead(7);
        watched.note(6, 10);
        assert!(!watched.is_passed(u32::MAX / 2), "its line has not come");
        watched.note(9, u32::MAX);
        watched.note(10, 5);
        assert!(!watched.is_passed(u32::MAX - 1));
        assert!(watched.is_passed(u32::MAX) && watched.is_passed(3), "modulo 2^32");
        assert!(!WatchedLine::None.is_passed(0));
    }
}
