//! The extruder's steps between the master's. The hot loop checks here for each step (R1); an
//! extruder step is rare (R3).

use crate::methods::Pieces;
use crate::step_times::StepTimes;
use crate::time_units::{FRACTION_BITS, HALF_TICK};

/// Extruder step found before the master's next step.
pub(crate) enum Look {
    /// No extruder step.
    Free,
    /// An extruder step so little before the master's that it waits for it.
    Again,
    /// An extruder step, this many ticks after the last event.
    Step(u32),
    /// The extruder's step is too close to the last event; it has not been taken.
    TooNear,
}

/// The extruder's steps while the master's are taken one by one.
pub(crate) struct ExtruderGap {
    /// Time of the last event, a whole tick, when the extruder was last checked.
    start: u64,
    /// Ticks from then on during which no extruder step was due.
    pub(crate) free: u32,
    /// An extruder step closer than this to the master's next one waits for it.
    near: u64,
    /// Minimum number of ticks between events.
    pub(crate) least: u32,
    /// Number of the event that an extruder step waits for; `usize::MAX` if no step waits.
    pub(crate) joint: usize,
    /// True once an extruder step has begun to wait.
    pub(crate) has_joined: bool,
    /// Number of extruder steps taken that are separate events.
    pub(crate) steps: usize,
}

impl ExtruderGap {
    /// State with the last event at `last`; `waits`: a step waits for the next one.
    #[inline(always)]
    pub(crate) fn new<P: Pieces>(extruder: &StepTimes<P>, last: u64, waits: bool, near: u64, least: u32) -> Self {
        let joint = if waits { 0 } else { usize::MAX };
        Self { start: last, free: extruder.ticks_from(last), near, least, joint, has_joined: false, steps: 0 }
    }

    /// Time of the last event, given that no extruder step is due for `free` ticks.
    #[inline(always)]
    pub(crate) fn last(&self, free: u32) -> u64 {
        self.start.wrapping_add(u64::from(self.free.wrapping_sub(free)) << FRACTION_BITS)
    }

    /// Notes that the master has stepped, and that no extruder step is due for `free` ticks.
    #[inline(always)]
    fn settle(&mut self, free: u32) {
        self.start = self.last(free);
        self.free = free;
    }

    /// Time from the last event to the extruder's next step, in time units, half a tick included;
    /// `None` if there is no further step. Wraps if the step was due before that event.
    fn distance<P: Pieces>(&self, extruder: &StepTimes<P>) -> Option<u64> {
        extruder.next().map(|due| due.wrapping_add(HALF_TICK).wrapping_sub(self.start))
    }

    /// Number of the master's `count` steps that come before the extruder's next step. No extruder
    /// step is due for `free` ticks; the master's first step is `gap` time units after the last
    /// event and the others follow at this interval. At least one; never too many, and very rarely
    /// one too few.
    #[cold]
    #[inline(never)]
    pub(crate) fn fitting<P: Pieces>(
        &mut self,
        extruder: &StepTimes<P>,
        free: u32,
        [gap, interval]: [u64; 2],
        count: u32,
    ) -> u32 {
        self.settle(free);
        let last = gap.wrapping_add(interval.wrapping_mul(u64::from(count.wrapping_sub(1))));
        if last >> FRACTION_BITS < u64::from(free) {
            return count;
        }
        let Some(distance) = self.distance(extruder) else { return count };
        // Truncated.
        let distance = distance.saturating_sub(gap) >> 12;
        let interval = u32::try_from(interval >> 12).unwrap_or(u32::MAX).saturating_add(1);
        let fitting = u32::try_from(distance).unwrap_or(u32::MAX) / interval;
        fitting.saturating_add(1).min(count)
    }

    /// Notes a stair that ends this many ticks after the last event, perhaps a little later than
    /// the extruder's next step, which is then checked only after it. Returns the ticks without a
    /// check.
    pub(crate) fn free_for(&mut self, ticks: u32) -> u32 {
        self.free = self.free.max(ticks);
        self.free
    }

    /// Takes the extruder's next step if it comes before the master's, which is `gap` after the
    /// last event and will be the event of this number; none is due for `free` ticks.
    // Most steps have no extruder step before them.
    #[cold]
    #[inline(never)]
    pub(crate) fn look<P: Pieces>(&mut self, extruder: &mut StepTimes<P>, free: u32, gap: u64, number: usize) -> Look {
        self.settle(free);
        let Some(behind) = self.distance(extruder) else {
            self.free = u32::MAX;
            return Look::Free;
        };
        if behind >= gap {
            // An event had to keep its distance, and the step was due before it.
            if behind.cast_signed() < 0 {
                return Look::TooNear;
            }
            // The extruder's step may be in the same tick. The next check is for the event after
            // that.
            self.free = free.max(((gap >> FRACTION_BITS) as u32).saturating_add(1));
            return Look::Free;
        }
        let ticks = (behind >> FRACTION_BITS) as u32;
        let waits = gap - behind < self.near;
        // A run has room for one waiting step: another would need a second note.
        if waits && self.joint != usize::MAX || !waits && ticks < self.least {
            return Look::TooNear;
        }
        extruder.take(1);
        let look = if waits {
            self.joint = number;
            self.has_joined = true;
            Look::Again
        } else {
            self.steps += 1;
            self.start = self.start.wrapping_add(u64::from(ticks) << FRACTION_BITS);
            Look::Step(ticks)
        };
        self.free = extruder.ticks_from(self.start);
        look
    }
}
