//! Limits that a tolerance of the filtered path sets for a move and the block before it.

use super::Planner;
use super::block_rules::Planned;
use crate::block::{Acceleration, Speed};
use crate::methods::MotionMethods;
use crate::ring::RingMemory;
use crate::tolerance::{Beside, PathTolerance};

impl Planned {
    /// The move as its corners see it.
    fn beside(&self) -> Beside<'_> {
        Beside {
            path: &self.path,
            allowed: self.corner_acceleration.mm_per_s2(),
            acceleration: self.acceleration.mm_per_s2_f32(),
        }
    }
}

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// Lowers the speed in the corner before a move, its acceleration and that of the open block as
    /// far as the tolerance asks, if there is one. Doing it again changes nothing.
    #[inline(always)]
    pub(super) fn keep_tolerance(&mut self, planned: &mut Planned) {
        if let Some(tolerance) = self.rules.tolerance {
            self.hold_to(&tolerance, planned);
        }
    }

    #[inline(never)]
    fn hold_to(&mut self, tolerance: &PathTolerance, planned: &mut Planned) {
        if !planned.corner_acceleration.is_some() {
            let ticks = planned.nominal.ticks_for(planned.length_10nm);
            let is_still_forgotten = !self.previous.acceleration.is_some() && self.previous.is_forgotten;
            planned.is_forgotten = is_still_forgotten || tolerance.forgets(ticks);
            if planned.is_forgotten {
                // The filters do not see later moves together with the open block.
                self.open.hold_end_to(Acceleration::MAX);
            }
            return;
        }
        let along = tolerance.along(&planned.path, planned.acceleration.mm_per_s2_f32());
        planned.acceleration = planned.acceleration.min(Acceleration::from_mm_per_s2_f32(along));
        if !self.previous.acceleration.is_some() {
            if !self.previous.is_forgotten {
                let held = tolerance.beside_any(&planned.beside());
                planned.acceleration = planned.acceleration.min(Acceleration::from_mm_per_s2_f32(held));
            }
            return;
        }
        let nominal = planned.nominal.min(self.open.nominal()).mm_per_s_f32();
        let extruder = self.rules.path_limits.line_filament_acceleration_mm_per_s2();
        let corner = tolerance.corner(&[self.before_corner(), planned.beside()], nominal, extruder);
        let [before, after] = corner.accelerations.map(Acceleration::from_mm_per_s2_f32);
        planned.corner = planned.corner.min(Speed::from_mm_per_s_f32(corner.mm_per_s));
        planned.acceleration = planned.acceleration.min(after);
        self.open.hold_end_to(before);
    }

    /// The last move taken, which the open block ends with.
    fn before_corner(&self) -> Beside<'_> {
        Beside {
            path: &self.previous.path,
            allowed: self.previous.acceleration.mm_per_s2(),
            acceleration: self.open.acceleration_before_end().mm_per_s2_f32(),
        }
    }

    /// Keeps the tolerance as the open block closes before the next move is known,
    /// whatever it may be.
    #[inline(always)]
    pub(super) fn keep_tolerance_before_any(&mut self) {
        if let Some(tolerance) = self.rules.tolerance
            && !self.open.is_end_known()
            && self.previous.acceleration.is_some()
        {
            let held = tolerance.beside_any(&self.before_corner());
            self.open.hold_end_to(Acceleration::from_mm_per_s2_f32(held));
        }
    }
}
