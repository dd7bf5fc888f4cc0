//! Step entries that have been made and not yet handed out.

use crate::step_queue::StepEntry;

/// Events or stairs computed in one call of [`crate::interpolator::Interpolator::advance`].
pub(crate) const EVENTS_AT_ONCE: usize = 48;

/// Maximum number of entries that a single call of the interpolator hands to its sink.
pub const MAX_ENTRIES: usize = EVENTS_AT_ONCE + 1;

/// Up to `MOST` entries in order, handed out together (R9).
#[derive(Clone, Copy, Debug)]
pub(crate) struct EventBuffer<const MOST: usize> {
    entries: [StepEntry; MOST],
    count: usize,
}

impl<const MOST: usize> EventBuffer<MOST> {
    /// Empty.
    pub(crate) const NONE: Self = Self { entries: [StepEntry::wait(0); MOST], count: 0 };

    /// Adds an entry; there must be room.
    #[inline(always)]
    pub(crate) fn push(&mut self, entry: StepEntry) {
        if let Some(place) = self.entries.get_mut(self.count) {
            *place = entry;
            self.count += 1;
        }
    }

    /// Room for up to `most` more entries; [`Self::filled`] takes the number written.
    #[inline(always)]
    pub(crate) fn room(&mut self, most: usize) -> &mut [StepEntry] {
        let free = self.entries.get_mut(self.count..).unwrap_or_default();
        let most = most.min(free.len());
        free.get_mut(..most).unwrap_or_default()
    }

    /// Counts `count` more entries.
    #[inline(always)]
    pub(crate) fn filled(&mut self, count: usize) {
        self.count += count;
    }

    /// Adds steps of `axes` to the entry `from_end` places from the end, 1 being the last.
    pub(crate) fn join(&mut self, from_end: usize, axes: u8) {
        if let Some(entry) = self.count.checked_sub(from_end).and_then(|index| self.entries.get_mut(index)) {
            *entry = entry.with(axes);
        }
    }

    /// The last entry.
    pub(crate) fn last(&mut self) -> Option<&mut StepEntry> {
        self.count.checked_sub(1).and_then(|last| self.entries.get_mut(last))
    }

    /// All entries.
    pub(crate) fn all(&self) -> &[StepEntry] {
        self.entries.get(..self.count).unwrap_or_default()
    }

    /// All entries except the last.
    pub(crate) fn all_but_last(&self) -> &[StepEntry] {
        self.entries.get(..self.count.saturating_sub(1)).unwrap_or_default()
    }

    /// Discards all entries except the last.
    pub(crate) fn keep_last(&mut self) {
        if let Some(last) = self.last().copied() {
            self.count = 0;
            self.push(last);
        }
    }

    /// Empties the buffer.
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }
}
