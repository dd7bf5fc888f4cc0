//! Parts shared by the stages between the planner and the step queue: entries that wait for a
//! stage, and entries that it hands on.

use crate::event_buffer::{EventBuffer, MAX_ENTRIES};
use crate::step_queue::{Notice, StepEntry};

/// Entries handed on together: few, since they are on the caller's stack.
const AT_ONCE: usize = 16;

/// The most entries that one event needs: a change of direction before it, and a step in the middle
/// of its interval.
const MAX_FOR_EVENT: usize = 3;

/// Notices that follow the waiting entries: the ends of a move and of a block, of one
/// call of the planner.
const NOTICES: usize = 4;

/// A few entries that leave a stage.
#[derive(Clone, Copy, Debug)]
pub struct PassedEntries {
    buffer: EventBuffer<AT_ONCE>,
}

impl PassedEntries {
    /// Nothing waits.
    pub const NONE: Self = Self { buffer: EventBuffer::NONE };

    /// All of them.
    pub fn all(&self) -> &[StepEntry] {
        self.buffer.all()
    }

    /// True if another event fits, whatever it needs.
    pub(crate) fn has_room(&self) -> bool {
        self.all().len() + MAX_FOR_EVENT <= AT_ONCE
    }

    pub(crate) fn push(&mut self, entry: StepEntry) {
        self.buffer.push(entry);
    }
}

/// A stage between the planner and the step queue that adds steps to those that pass.
pub(crate) trait Stage {
    /// Entries and notices that wait for the stage.
    fn waiting(&mut self) -> &mut Waiting;

    /// Adds an entry to `out`, or the first events of it, with its own steps, and
    /// passes the finished events.
    fn pass(&mut self, entry: StepEntry, out: &mut PassedEntries);

    /// Steps of X, Y and Z (A, B, Z) that it has added: the planner does not know of them.
    fn added_steps(&self) -> [i32; 3];

    /// Passes on the next waiting item: writes entries to `out`, which must be empty, or returns
    /// the notice that follows them.
    fn pass_on(&mut self, out: &mut PassedEntries) -> Option<Notice> {
        while let Some(entry) = self.waiting().entry() {
            if !out.has_room() {
                return None;
            }
            self.pass(entry, out);
        }
        if !out.all().is_empty() {
            return None;
        }
        let notice = self.waiting().next_notice()?;
        let Notice::BlockEnded { tick, mut motor_steps } = notice else { return Some(notice) };
        for (steps, added) in motor_steps.iter_mut().zip(self.added_steps()) {
            *steps = steps.wrapping_add(added.into());
        }
        Some(Notice::BlockEnded { tick, motor_steps })
    }
}

/// Entries that wait for a stage, and notices that follow them: at most the output of one
/// call of the planner.
#[derive(Debug)]
pub(crate) struct Waiting {
    entries: EventBuffer<MAX_ENTRIES>,
    /// Entries done, and events done of the next one.
    done: usize,
    events_done: u16,
    notices: [Option<Notice>; NOTICES],
}

impl Waiting {
    /// Empty.
    pub(crate) const NONE: Self =
        Self { entries: EventBuffer::NONE, done: 0, events_done: 0, notices: [None; NOTICES] };

    /// Adds entries; only those of the same call of the planner wait.
    pub(crate) fn take(&mut self, entries: &[StepEntry]) {
        for entry in entries {
            self.entries.push(*entry);
        }
    }

    /// Adds a notice after the entries.
    pub(crate) fn take_notice(&mut self, notice: &Notice) {
        if let Some(free) = self.notices.iter_mut().find(|notice| notice.is_none()) {
            *free = Some(*notice);
        }
    }

    /// True if anything waits.
    pub(crate) fn is_any(&self) -> bool {
        self.done < self.entries.all().len() || self.notices.iter().any(Option::is_some)
    }

    /// The entry that comes next.
    pub(crate) fn entry(&self) -> Option<StepEntry> {
        self.entries.all().get(self.done).copied()
    }

    /// Events left in the next entry.
    pub(crate) fn events_left(&self) -> u16 {
        self.entry().map_or(0, StepEntry::count).wrapping_sub(self.events_done)
    }

    /// Marks this many events of the next entry as done.
    pub(crate) fn pass_events(&mut self, events: u16) {
        if events < self.events_left() {
            self.events_done = self.events_done.wrapping_add(events);
        } else {
            self.pass_entry();
        }
    }

    /// Marks the next entry as done.
    pub(crate) fn pass_entry(&mut self) {
        (self.done, self.events_done) = (self.done + 1, 0);
        if self.done >= self.entries.all().len() {
            self.entries.clear();
            self.done = 0;
        }
    }

    /// Takes the notice that comes next, when no entry waits.
    pub(crate) fn next_notice(&mut self) -> Option<Notice> {
        self.notices.iter_mut().find_map(Option::take)
    }
}
