//! Entries that have Z's correction, on their way to the step queue.

use crate::event_buffer::EventBuffer;
use crate::step_queue::StepEntry;

/// Entries handed on together: few, since they are on the caller's stack.
const AT_ONCE: usize = 16;

/// The most entries that one event needs: a change of direction before it, and a step of Z in the middle of its interval.
const MAX_FOR_EVENT: usize = 3;

/// A few entries.
#[derive(Clone, Copy, Debug)]
pub struct BedEntries {
    buffer: EventBuffer<AT_ONCE>,
}

impl BedEntries {
    /// Empty.
    pub const NONE: Self = Self { buffer: EventBuffer::NONE };

    /// All of them.
    pub fn all(&self) -> &[StepEntry] {
        self.buffer.all()
    }

    /// Whether another event fits, whatever it needs.
    pub(super) fn has_room(&self) -> bool {
        self.all().len() + MAX_FOR_EVENT <= AT_ONCE
    }

    pub(super) fn push(&mut self, entry: StepEntry) {
        self.buffer.push(entry);
    }
}
