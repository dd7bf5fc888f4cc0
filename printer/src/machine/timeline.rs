//! Duration of the motion in the step queue.

use heapless::Deque;

/// Marks in the queue.
const MARKS: usize = 64;

/// Marks are at least this far apart: 1 ms.
const SPACING_TICKS: u64 = ferrostep_planner::TICKS_PER_SECOND as u64 / 1000;

/// Marks that say at which tick a slot of the queue ends.
#[derive(Debug, Default)]
pub struct Timeline {
    marks: Deque<(u32, u64), MARKS>,
    last_tick: u64,
}

impl Timeline {
    /// `queued` slots have been filled so far, modulo 2^32, and end at `tick`.
    pub fn mark(&mut self, queued: u32, tick: u64) {
        // The fuller the queue, the coarser the marks, so that they always suffice.
        let spacing = SPACING_TICKS.max(self.remaining_ticks(tick) / (MARKS as u64 / 2));
        if tick.saturating_sub(self.last_tick) < spacing {
            return;
        }
        if self.marks.is_full() {
            self.thin_out();
        }
        if self.marks.push_back((queued, tick)).is_ok() {
            self.last_tick = tick;
        }
    }

    /// Keeps every second mark.
    fn thin_out(&mut self) {
        for index in 0..self.marks.len() {
            if let Some(mark) = self.marks.pop_front()
                && index % 2 == 1
            {
                // There is room: one mark was taken out just now.
                let _ = self.marks.push_back(mark);
            }
        }
    }

    /// Drops the marks of the slots that have been played: `played` of them, modulo 2^32.
    pub fn pass(&mut self, played: u32) {
        while self.marks.front().is_some_and(|&(slot, _)| played.wrapping_sub(slot) as i32 >= 0) {
            self.marks.pop_front();
        }
    }

    /// Least motion that remains if the queue ends at `end_tick`: from the first mark that has not been played to there.
    pub fn remaining_ticks(&self, end_tick: u64) -> u64 {
        self.marks.front().map_or(0, |&(_, tick)| end_tick.saturating_sub(tick))
    }

    /// Drops all marks: the queue is empty, and goes on at `tick`.
    pub fn clear(&mut self, tick: u64) {
        self.marks.clear();
        self.last_tick = tick;
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
                timeline.mark(index as u32 + 1, end);
                if let Some(played) = index.checked_sub(ahead) {
                    played_end = ends[played];
                    timeline.pass(played as u32 + 1);
                }
                let (left, truly) = (timeline.remaining_ticks(end), end - played_end);
                prop_assert!(left <= truly);
                // The slot in play may be any part of what is missing, and so may a gap between marks.
                let longest = slots[index.saturating_sub(ahead)..=index].iter().max().copied().unwrap_or(0);
                prop_assert!(truly - left <= 2 * longest + SPACING_TICKS + truly / 6, "{} of {}", left, truly);
            }
        }
    }
}
