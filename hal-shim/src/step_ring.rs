//! The step queue: one side fills it, one side empties it, neither ever waits.

use core::sync::atomic::{AtomicU32, Ordering};

use ferrostep_planner::StepEntry;

/// A ring of `N` step entries, `N` a power of two, for one producer and one consumer of any priorities.
///
/// Entries are kept as words in atomics, which cost what plain memory costs on a Cortex-M: so the ring needs no unsafe
/// code, and taking an entry has no branch that could panic (an index is cut to the ring by a mask). Two producers, or
/// two consumers, would lose entries but never do anything undefined.
#[derive(Debug)]
pub struct StepRing<const N: usize> {
    slots: [[AtomicU32; 2]; N],
    /// Entries taken so far, modulo 2^32.
    taken: AtomicU32,
    /// Entries added so far, modulo 2^32.
    added: AtomicU32,
}

impl<const N: usize> Default for StepRing<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> StepRing<N> {
    /// An empty ring.
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two() && N <= 1 << 30) };
        Self {
            slots: [const { [const { AtomicU32::new(0) }; 2] }; N],
            taken: AtomicU32::new(0),
            added: AtomicU32::new(0),
        }
    }

    /// Entries that wait.
    pub fn len(&self) -> usize {
        self.added.load(Ordering::Acquire).wrapping_sub(self.taken.load(Ordering::Acquire)) as usize
    }

    /// Whether no entry waits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How many more entries fit.
    pub fn room(&self) -> usize {
        N.saturating_sub(self.len())
    }

    /// For the producer: adds an entry; `false` without room.
    #[inline]
    pub fn push(&self, entry: StepEntry) -> bool {
        let added = self.added.load(Ordering::Relaxed);
        if added.wrapping_sub(self.taken.load(Ordering::Acquire)) as usize >= N {
            return false;
        }
        for (word, value) in self.slots[added as usize & (N - 1)].iter().zip(entry.to_words()) {
            word.store(value, Ordering::Relaxed);
        }
        self.added.store(added.wrapping_add(1), Ordering::Release);
        true
    }

    /// For the consumer: takes the oldest entry.
    #[inline]
    pub fn pop(&self) -> Option<StepEntry> {
        let taken = self.taken.load(Ordering::Relaxed);
        if taken == self.added.load(Ordering::Acquire) {
            return None;
        }
        let [first, second] = &self.slots[taken as usize & (N - 1)];
        let entry = StepEntry::from_words([first.load(Ordering::Relaxed), second.load(Ordering::Relaxed)]);
        self.taken.store(taken.wrapping_add(1), Ordering::Release);
        Some(entry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    proptest! {
        #[test]
        fn entries_come_out_as_they_went_in(pushes in proptest::collection::vec((0u8..12, 0u8..12), 0..60), start: u32) {
            let ring = StepRing::<8>::new();
            // The counters may pass the end of their 32 bits.
            ring.taken.store(start, Ordering::Relaxed);
            ring.added.store(start, Ordering::Relaxed);
            let mut model = VecDeque::new();
            let mut number = 0;
            for (pushed, popped) in pushes {
                for _ in 0..pushed {
                    number += 1;
                    let entry = StepEntry::wait(number);
                    let fits = model.len() < 8;
                    prop_assert_eq!(ring.room() > 0, fits);
                    prop_assert_eq!(ring.push(entry), fits);
                    if fits {
                        model.push_back(entry);
                    }
                }
                for _ in 0..popped {
                    prop_assert_eq!(ring.pop(), model.pop_front());
                }
                prop_assert_eq!(ring.len(), model.len());
                prop_assert_eq!(ring.is_empty(), model.is_empty());
            }
        }
    }

    #[test]
    fn two_threads_lose_nothing() {
        const COUNT: u32 = 200_000;
        let ring = StepRing::<64>::new();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for number in 0..COUNT {
                    while !ring.push(StepEntry::wait(number)) {
                        std::hint::spin_loop();
                    }
                }
            });
            for number in 0..COUNT {
                let entry = loop {
                    if let Some(entry) = ring.pop() {
                        break entry;
                    }
                    std::hint::spin_loop();
                };
                assert_eq!(entry, StepEntry::wait(number));
            }
        });
        assert!(ring.is_empty());
    }
}
