//! What the steps of a block tell of its speeds: the limits of blocks that come without the positions they were made from.
//!
//! A motor stands within half a step of where it should, so a block's travel along an axis is known to the steps of the motors
//! that move it (half a step of each of two on CoreXY and CoreXZ, whose motors may have steps of different lengths). By that
//! much the checks give way, and by rounding in single precision.

use super::block_rules::{BlockRules, TICKS_PER_10NM_AT_1_MM_PER_S, steps_of_master};
use crate::block::{Block, Speed};
use crate::kinematics::UNITS_PER_MM;
use crate::limits::{larger, smaller};
use crate::methods::{MotionMethods, StepPattern};
use crate::square_root::square_root_f32;

/// What rounding may be off, of a whole.
const LENIENCE: f32 = 1.001;

impl<M: MotionMethods> BlockRules<M> {
    /// How far a block goes along X, Y, Z and the filament, mm.
    fn travels_mm(&self, block: &Block) -> [f32; 4] {
        let step_mm = self.step_mm;
        let [first, second, third] = block.steps.map(|steps| steps as f32);
        let motors_mm = [first * step_mm[0], second * step_mm[1], third * step_mm[2]];
        let [x, y, z] = self.geometry.kinematics.position(motors_mm);
        let filament = block.extruder_256ths as f32 * (step_mm[3] / 256.0);
        [x, y, z, filament]
    }

    /// Whether a block's nominal speed and acceleration keep the limits of all axes, and its events their distance.
    pub(super) fn keeps_limits(&self, block: &Block) -> bool {
        let mm = self.travels_mm(block);
        let length = block.length_10nm as f32 / UNITS_PER_MM as f32;
        let (feed, acceleration) = (block.nominal.mm_per_s_f32(), block.acceleration.mm_per_s2_f32());
        let limits = &self.path_limits;
        let most =
            larger(larger(limits.print_acceleration(), limits.travel_acceleration()), limits.retract_acceleration());
        if acceleration > most * LENIENCE {
            return false;
        }
        let (max_feed, max_acceleration) = limits.of_axes();
        // The filament has its fractions of steps.
        let [x, y, z] = self.slack_mm;
        let slack_mm = [x, y, z, self.step_mm[3] / 128.0];
        for axis in 0..4 {
            let slack = slack_mm[axis];
            let travel = larger(mm[axis].abs() - slack, 0.0);
            if feed * travel > max_feed[axis] * length * LENIENCE
                || acceleration * travel > max_acceleration[axis] * length * LENIENCE
            {
                return false;
            }
        }
        let densest = match &self.pattern {
            None => steps_of_master(block.steps),
            Some(pattern) => pattern.densest(block.steps),
        };
        let densest = larger(densest as f32, block.extruder_256ths.unsigned_abs() as f32 / 256.0);
        let shortest_ticks = densest * self.geometry.minimum_event_interval_ticks as f32;
        feed * shortest_ticks <= block.length_10nm as f32 * TICKS_PER_10NM_AT_1_MM_PER_S * LENIENCE
    }

    /// The most that the corner before a block allows, by its steps and those of the block before: v^2 = a R as for any
    /// corner (Yu 2019), the turn as small as half a step at each end can make it look. A stop next to a block of the
    /// filament alone.
    pub(super) fn corner_of_steps(&self, before: Option<&Block>, block: &Block) -> Speed {
        let Some(before) = before else { return Speed(u32::MAX) };
        let lengths = [before, block].map(|block| block.length_10nm as f32 / UNITS_PER_MM as f32);
        let [one, other] = [before, block].map(|block| self.travels_mm(block));
        let stands = [before, block].map(|block| block.steps == [0; 3]);
        let [x, y, z, _] = self.step_mm;
        for (length, stands) in lengths.into_iter().zip(stands) {
            // A path without a step is shorter than a step of each of its motors: what is longer is filament alone. What is
            // not may be either.
            if stands && length > (x + y + z) * LENIENCE {
                return Speed::ZERO;
            }
        }
        let mut apart = 0.0;
        for axis in 0..3 {
            // Of unit vectors; each component is off by its slack at most.
            let slack = self.slack_mm[axis] / lengths[0] + self.slack_mm[axis] / lengths[1];
            let difference = (one[axis] / lengths[0] - other[axis] / lengths[1]).abs();
            let least = larger(difference - slack, 0.0);
            apart += least * least;
        }
        // |u - w| = 2 sin(theta/2).
        let sine_squared = smaller(apart / 4.0 / LENIENCE, 1.0);
        if sine_squared <= 1e-6 {
            return Speed(u32::MAX);
        }
        let (sine, cosine) = (square_root_f32(sine_squared), square_root_f32(1.0 - sine_squared));
        let deviation_mm = self.path_limits.four_deviations_10nm / (4 * UNITS_PER_MM) as f32;
        let within_deviation = deviation_mm * cosine * (1.0 + cosine) / sine_squared;
        let fitting = 0.5 * smaller(lengths[0], lengths[1]) * cosine / sine;
        let acceleration = smaller(before.acceleration.mm_per_s2_f32(), block.acceleration.mm_per_s2_f32());
        let squared_mm2_per_s2 = smaller(within_deviation, fitting) * acceleration * LENIENCE;
        Speed::from_mm_per_s_f32(square_root_f32(squared_mm2_per_s2))
    }
}
