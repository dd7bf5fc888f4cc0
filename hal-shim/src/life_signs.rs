//! Whether every task is alive: the watchdog is fed only then.

use core::sync::atomic::{AtomicU8, Ordering};

/// A task that must show life.
///
/// Those above the lowest of them, and interrupts, need not: where one of them never ends, the lowest never runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The heaters' control.
    Temperature,
    /// What keeps the step queue full.
    Planner,
    /// What is said without being asked: the lowest.
    Reports,
}

impl Task {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Temperature, Self::Planner, Self::Reports];

    const fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// Which tasks have shown life since the watchdog was last fed.
#[derive(Debug, Default)]
pub struct LifeSigns(AtomicU8);

impl LifeSigns {
    /// None has.
    pub const fn new() -> Self {
        Self(AtomicU8::new(0))
    }

    /// A task has begun a round of its work.
    pub fn show(&self, task: Task) {
        self.0.fetch_or(task.bit(), Ordering::Relaxed);
    }

    /// Whether all have; if so, they must anew.
    pub fn take_all(&self) -> bool {
        let all = Task::ALL.iter().fold(0, |all, task| all | task.bit());
        let seen = self.0.load(Ordering::Relaxed) == all;
        if seen {
            self.0.store(0, Ordering::Relaxed);
        }
        seen
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn one_that_is_silent_is_enough() {
        for silent in Task::ALL {
            let signs = LifeSigns::new();
            for _ in 0..10 {
                Task::ALL.into_iter().filter(|task| *task != silent).for_each(|task| signs.show(task));
                assert!(!signs.take_all(), "{silent:?}");
            }
            signs.show(silent);
            assert!(signs.take_all());
            assert!(!signs.take_all(), "all must show life again");
        }
    }

    proptest! {
        /// Between two feeds every task has run.
        #[test]
        fn each_feed_is_worth_a_round_of_every_task(shown in prop::collection::vec(0_usize..3, 0..100)) {
            let signs = LifeSigns::new();
            let mut since = [0; 3];
            for task in shown {
                signs.show(Task::ALL[task]);
                since[task] += 1;
                let fed = signs.take_all();
                prop_assert_eq!(fed, since.iter().all(|rounds| *rounds > 0));
                if fed {
                    since = [0; 3];
                }
            }
        }
    }
}
