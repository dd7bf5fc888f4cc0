//! Planning without execution, for estimates and for counts of planning's cost.

use crate::block::PlannedBlock;
use crate::methods::MotionMethods;
use crate::ring::RingMemory;
use crate::speed_plan::Released;

use super::Planner;

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// Takes the next block that may leave without executing it, for estimates.
    pub fn next_planned(&mut self) -> Option<PlannedBlock> {
        loop {
            let released = self.release_next()?;
            if let Some(planned) = self.pass_over(&released) {
                return Some(planned);
            }
        }
    }

    /// Counts the time in which the motors come to rest, if all blocks were passed over, for
    /// estimates. Returns it in ticks.
    pub fn pass_over_rest(&mut self) -> u64 {
        if !self.owes_rest || !self.is_look_ahead_empty() {
            return 0;
        }
        self.owes_rest = false;
        let ticks = u64::from(self.shaped.length_ticks());
        self.tallies.motion_ticks += ticks;
        ticks
    }

    /// Counts the time of a block that is not executed; `None` for a marker.
    pub(super) fn pass_over(&mut self, released: &Released) -> Option<PlannedBlock> {
        let (planned, ticks) = match released {
            Released::Block(planned) => (*planned, self.law(planned).duration_ticks()),
            Released::Part(part) => {
                let (planned, law) = self.along(part);
                (planned, law.duration_ticks())
            }
            Released::Marker(_) => return None,
        };
        self.tallies.motion_ticks += ticks;
        self.owes_rest |= self.is_shaping();
        Some(planned)
    }

    /// Takes the next block that may leave, shows it with its speeds, and does nothing more, to
    /// count what planning costs. Returns `false` if there was no block.
    pub fn take_planned(&mut self, see: impl FnOnce(&PlannedBlock)) -> bool {
        loop {
            match &self.release_next() {
                Some(Released::Block(planned)) => see(planned),
                Some(Released::Part(part)) => see(&self.along(part).0),
                Some(Released::Marker(_)) => continue,
                None => return false,
            }
            return true;
        }
    }
}
