//! The ends of source lines' moves, for one who follows a job's time from line to line.

use std::cell::RefCell;
use std::collections::VecDeque;

/// The ends that have been reached and not been taken: source line and motion clock, ticks.
#[derive(Debug, Default)]
pub struct LineEnds(RefCell<VecDeque<(u32, u64)>>);

impl LineEnds {
    /// Notes that motion of a line has ended, or a part of it; the last part of a line counts.
    pub(crate) fn note(&self, line: u32, tick: u64) {
        let mut ends = self.0.borrow_mut();
        match ends.back_mut() {
            Some((before, end)) if *before == line => *end = tick,
            _ => ends.push_back((line, tick)),
        }
    }

    /// Takes the first end.
    pub fn take(&self) -> Option<(u32, u64)> {
        self.0.borrow_mut().pop_front()
    }
}
