//! Duration of the motion in the step queue, and the filament that it pushes.

use heapless::Deque;

use super::pushed::{Pushed, PushedFilament};

/// Marks in the queue.
const MARKS: usize = 64;

/// Marks are at least this far apart: 1 ms.
const SPACING_TICKS: u64 = ferrostep_planner::TICKS_PER_SECOND as u64 / 1000;

/// An interval of the queue, from the mark before it.
#[derive(Clone, Copy, Debug)]
struct Mark {
    /// Slots filled up to its end, modulo 2^32.
    queued: u32,
    /// Filament pushed up to its beginning.
    pushed_before: Pushed,
    /// Tick of the interval's end.
    tick: u64,
}

/// Marks that say at which tick a slot of the queue ends.
#[derive(Debug, Default)]
pub struct Timeline {
    marks: Deque<Mark, MARKS>,
    last_tick: u64,
    /// Filament pushed up to the newest mark.
    marked: Pushed,
}

impl Timeline {
    /// `queued` slots have been filled so far, modulo 2^32, and end at `tick`, when filament will
    /// have been pushed up to `pushed`.
    pub fn mark(&mut self, queued: u32, tick: u64, pushed: Pushed) {
        // The fuller the queue, the coarser the marks, so that they always suffice.
        let spacing = SPACING_TICKS.max(self.remaining_ticks(tick) / (MARKS as u64 / 2));
        if tick.saturating_sub(self.last_tick) < spacing {
            return;
        }
        if self.marks.is_full() {
            self.thin_out();
        }
        if self.marks.push_back(Mark { queued, pushed_before: self.marked, tick }).is_ok() {
            self.last_tick = tick;
            self.marked = pushed;
        }
    }

    /// Keeps every second mark.
    fn thin_out(&mut self) {
        let mut pushed_before = Pushed::default();
        for index in 0..self.marks.len() {
            let Some(mark) = self.marks.pop_front() else { return };
            if index % 2 == 0 {
                pushed_before = mark.pushed_before;
            } else {
                // There is room: one mark was taken out just now.
                let _ = self.marks.push_back(Mark { pushed_before, ..mark });
            }
        }
    }

    /// Drops the marks of the slots that have been played: `played` of them, modulo 2^32.
    pub fn pass(&mut self, played: u32) {
        while self.marks.front().is_some_and(|mark| played.wrapping_sub(mark.queued) as i32 >= 0) {
            self.marks.pop_front();
        }
    }

    /// Minimum motion that remains if the queue ends at `end_tick`: from the first mark that has
    /// not been played to there.
    pub fn remaining_ticks(&self, end_tick: u64) -> u64 {
        self.marks.front().map_or(0, |mark| end_tick.saturating_sub(mark.tick))
    }

    /// The interval that is being played, by the filament pushed up to its beginning and its end;
    /// the queue ends with `end`.
    pub fn pushed(&self, end: Pushed) -> PushedFilament {
        let mut marks = self.marks.iter();
        match marks.next() {
            None => PushedFilament { at_least: self.marked, at_most: end },
            Some(played) => PushedFilament {
                at_least: played.pushed_before,
                at_most: marks.next().map_or(self.marked, |next| next.pushed_before),
            },
        }
    }

    /// Drops all marks: the queue is empty, and continues at `tick`, with `pushed` so far.
    pub fn clear(&mut self, tick: u64, pushed: Pushed) {
        self.marks.clear();
        self.last_tick = tick;
        self.marked = pushed;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_left_is_known_to_a_millisecond_or_a_few_percent(
            slots in proptest::collection::vec(1u64..2_000_000, 1..400), ahead in 1usize..200,
        ) {
            let mut timeline = Timeline::default();
            let (mut end, mut played_end) = (0, 0);
            let ends: Vec<u64> = slots.iter().map(|ticks| { end += ticks; end }).collect();
            for (index, &end) in ends.iter().enumerate() {
                timeline.mark(index as u32 + 1, end, Pushed::default());
                if let Some(played) = index.checked_sub(ahead) {
                    played_end = ends[played];
                    timeline.pass(played as u32 + 1);
                }
                let (left, truly) = (timeline.remaining_ticks(end), end - played_end);
                prop_assert!(left <= truly);
                // The slot in play may be any part of the missing ticks, and so may a
                // gap between marks.
                let longest = slots[index.saturating_sub(ahead)..=index].iter().max().copied().unwrap_or(0);
                prop_assert!(truly - left <= 2 * longest + SPACING_TICKS + truly / 6, "{} of {}", left, truly);
            }
        }
    }
}
