//! Signs of life from every task: the watchdog is fed only while all are alive.

use core::sync::atomic::{AtomicU8, Ordering};

/// A task that must show life to the heaters' control, which feeds the watchdog.
///
/// Tasks above the lowest of them, and interrupts, need not: where one of them never ends, the
/// lowest never runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The planner, which keeps the step queue full.
    Planner,
    /// The task of unasked reports: the lowest of all.
    Reports,
}

impl Task {
    /// All of them, in the order of their index.
    pub const ALL: [Self; 2] = [Self::Planner, Self::Reports];

    const fn bit(self) -> u8 {
        1 << self as u8
    }

    /// Maximum time without a sign of life, ms.
    ///
    /// The planner runs every 2 ms for some ms at a time. The lowest task, every 100 ms, waits for
    /// a command at work (arithmetic of a line, or a long reply that waits for a slow host, 0.2 s),
    /// and for the planner while that is fully busy.
    pub const fn patience_ms(self) -> u32 {
        match self {
            Self::Planner => 1_000,
            Self::Reports => 5_000,
        }
    }
}

/// Tasks that have recently shown life.
#[derive(Debug, Default)]
pub struct LifeSigns(AtomicU8);

impl LifeSigns {
    /// No signs yet.
    pub const fn new() -> Self {
        Self(AtomicU8::new(0))
    }

    /// A task has begun a round of its work.
    pub fn show(&self, task: Task) {
        self.0.fetch_or(task.bit(), Ordering::Relaxed);
    }
}

/// The supervisor of the tasks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Vigil {
    silent_ms: [u32; 2],
}

impl Vigil {
    /// Counts `passed_ms` more, and returns true if no task has been silent for too long. A task
    /// that shows life again counts as alive again.
    pub fn all_alive(&mut self, signs: &LifeSigns, passed_ms: u32) -> bool {
        let seen = signs.0.swap(0, Ordering::Relaxed);
        for (silent_ms, task) in self.silent_ms.iter_mut().zip(Task::ALL) {
            *silent_ms = if seen & task.bit() == 0 { silent_ms.saturating_add(passed_ms) } else { 0 };
        }
        self.silent_ms.iter().zip(Task::ALL).all(|(silent_ms, task)| *silent_ms <= task.patience_ms())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn one_that_is_silent_for_too_long_is_enough() {
        for (silent, after_ms) in [(Task::Planner, 1_000), (Task::Reports, 5_000)] {
            let (signs, mut vigil) = (LifeSigns::new(), Vigil::default());
            let fed = (1..1_000_u32).take_while(|_| {
                Task::ALL.into_iter().filter(|task| *task != silent).for_each(|task| signs.show(task));
                vigil.all_alive(&signs, 10)
            });
            assert_eq!(fed.last(), Some(after_ms / 10), "{silent:?}");
            signs.show(silent);
            assert!(vigil.all_alive(&signs, 10));
        }
    }

    proptest! {
        /// The vigil returns true, in any order of events, exactly when each task was last seen no
        /// longer ago than its patience.
        #[test]
        fn the_vigil_counts_right(rounds in prop::collection::vec((0_u8..4, 1_u32..2_000), 0..60)) {
            let (signs, mut vigil) = (LifeSigns::new(), Vigil::default());
            let (mut now_ms, mut seen_ms) = (0, [0; 2]);
            for (shown, passed_ms) in rounds {
                now_ms += passed_ms;
                for task in Task::ALL.into_iter().filter(|task| shown & task.bit() != 0) {
                    signs.show(task);
                    seen_ms[task as usize] = now_ms;
                }
                let late = Task::ALL.into_iter().any(|task| now_ms - seen_ms[task as usize] > task.patience_ms());
                prop_assert_eq!(vigil.all_alive(&signs, passed_ms), !late);
            }
        }
    }
}
