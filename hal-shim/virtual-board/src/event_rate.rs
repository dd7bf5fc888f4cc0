//! The most events in any millisecond.

use ferrostep_planner::TICKS_PER_SECOND;

/// Events that fit into the window; the rate of more is given as of this many.
const CAPACITY: usize = 4096;
const WINDOW_TICKS: u64 = TICKS_PER_SECOND as u64 / 1000;

/// A sliding window of one millisecond over event times.
#[derive(Clone, Debug)]
pub struct EventRate {
    ticks: [u64; CAPACITY],
    newest: usize,
    length: usize,
    most: usize,
}

impl Default for EventRate {
    fn default() -> Self {
        Self { ticks: [0; CAPACITY], newest: 0, length: 0, most: 0 }
    }
}

impl EventRate {
    /// Adds an event; ticks never decrease.
    #[inline]
    pub fn add(&mut self, tick: u64) {
        self.newest = (self.newest + 1) % CAPACITY;
        self.ticks[self.newest] = tick;
        self.length += 1;
        // The window is half open: events exactly a millisecond apart are not in the same one.
        while self.length > CAPACITY
            || self.ticks[(self.newest + 1 + CAPACITY - self.length) % CAPACITY] + WINDOW_TICKS <= tick
        {
            self.length -= 1;
        }
        self.most = self.most.max(self.length);
    }

    /// Maximum number of events in any millisecond, times 1000.
    pub fn most_hz(&self) -> u64 {
        self.most as u64 * 1000
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_densest_millisecond_counts() {
        let mut rate = EventRate::default();
        for k in 0..100 {
            rate.add(1_000_000 + k * 8_400);
        }
        assert_eq!(rate.most_hz(), 10_000);
        rate.add(100_000_000);
        assert_eq!(rate.most_hz(), 10_000);
        for k in 0..10_000 {
            rate.add(200_000_000 + k * 2);
        }
        assert_eq!(rate.most_hz(), CAPACITY as u64 * 1000);
    }
}
