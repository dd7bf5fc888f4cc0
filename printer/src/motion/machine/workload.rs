//! The share of the processor that planning takes, and the pace that follows from it.

use ferrostep_planner::{Pace, TICKS_PER_SECOND};

/// Planning is judged each time it has taken this long, ticks: 2 ms.
const JUDGED_AFTER_TICKS: u64 = TICKS_PER_SECOND as u64 / 500;

/// Planning may take four fifths of the time that motion takes; the rest is for reading
/// lines, and a reserve.
const SHARE: (u64, u64) = (4, 5);

/// Time that planning took, and time that the planned motion would last at full speed.
///
/// Both are known before the motors start, and do not depend on ramps. A queue that runs low
/// would show it too late: braking takes more blocks than can be planned in the time that
/// the queue has left.
#[derive(Debug, Default)]
pub struct Workload {
    /// Time that planning took, ticks.
    taken: u64,
    /// Nominal ticks of all blocks before those that this time went into.
    before: u64,
    /// Nominal ticks of all blocks begun.
    begun: u64,
}

impl Workload {
    /// Adds `ticks` of planning; `nominal_ticks` are those of all blocks begun so far. Returns,
    /// every now and then, a pace that planning can keep.
    pub fn add(&mut self, ticks: u32, nominal_ticks: u64) -> Option<Pace> {
        self.taken = self.taken.saturating_add(u64::from(ticks));
        if nominal_ticks == self.begun {
            return None;
        }
        // A block has begun, so all that was begun before is done.
        let done = core::mem::replace(&mut self.begun, nominal_ticks);
        if self.taken < JUDGED_AFTER_TICKS {
            return None;
        }
        let wanted = done.saturating_sub(self.before);
        let (most, of) = SHARE;
        let share = wanted.saturating_mul(256 * most) / (self.taken * of);
        // Older work counts half.
        self.taken /= 2;
        self.before = done - wanted / 2;
        Some(Pace::from_256ths(share.min(256) as u16))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const MS: u32 = TICKS_PER_SECOND / 1000;

    /// Plans blocks that would last 1 ms each at full speed, in portions of such durations;
    /// returns the last pace.
    fn pace_of(portions: &[u32], blocks: u64) -> Option<Pace> {
        let mut workload = Workload::default();
        let mut pace = None;
        for block in 1..=blocks {
            for &portion in portions {
                pace = workload.add(portion, block * u64::from(MS)).or(pace);
            }
        }
        pace
    }

    #[test]
    fn the_pace_is_what_planning_can_keep() {
        // The first block's own planning has no motion to be compared with, so all estimates
        // are a little low.
        for (percent, least, most) in [(10, 256, 256), (79, 250, 256), (160, 120, 128), (800, 22, 26), (80_000, 1, 1)] {
            for portions in [vec![MS / 100 * percent], vec![MS / 400 * percent; 4]] {
                let pace = pace_of(&portions, 200).unwrap().in_256ths();
                assert!((least..=most).contains(&pace), "{pace} at {percent} %");
            }
        }
        assert_eq!(pace_of(&[MS / 10], 19), None);
    }

    #[test]
    fn planning_that_becomes_fast_again_gets_full_speed() {
        let mut workload = Workload::default();
        let mut nominal = 0;
        let mut pace_after = |percent: u32, blocks: u32| {
            let mut pace = None;
            for _ in 0..blocks {
                nominal += u64::from(MS);
                pace = workload.add(MS / 100 * percent, nominal).or(pace);
            }
            pace
        };
        assert!(pace_after(400, 50).unwrap() < Pace::from_256ths(60));
        assert_eq!(pace_after(5, 200), Some(Pace::FULL));
    }
}
