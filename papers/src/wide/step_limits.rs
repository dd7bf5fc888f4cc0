//! Limits of blocks that arrive without the positions they were made from, as far as their steps
//! reveal them.
//!
//! A motor is within half a step of its exact position, so a block's travel along an axis is known
//! to within the steps of the motors that move it (half a step of each of two on CoreXY and CoreXZ,
//! whose motors may have steps of different lengths). The checks allow for that much, and for
//! rounding in single precision.

use ferrostep_planner::inner_ends::InnerEnds;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::square_root::square_root_f32;
use ferrostep_planner::stretches::Stretch;
use ferrostep_planner::{Block, Geometry, Kinematics, Limits, MotionChoice, Speed, TICKS_PER_SECOND};

use crate::method::Method;

/// Factor by which rounding may exceed a limit.
const TOLERANCE: f32 = 1.001;

/// Number of ticks for 10 nm at 1 mm/s.
const TICKS_PER_10NM_AT_1_MM_PER_S: f32 = (TICKS_PER_SECOND as i64 / UNITS_PER_MM) as f32;

/// Copies a stretch of a block into a separate block.
pub(super) fn part(block: &Block, stretch: &Stretch) -> Block {
    Block {
        steps: stretch.steps,
        extruder_256ths: stretch.extruder_256ths,
        length_10nm: stretch.length_10nm,
        line: stretch.line,
        ends_move: stretch.ends_move,
        inner_ends: InnerEnds::NONE,
        ..*block
    }
}

/// Step lengths of a machine.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepSizes {
    /// Step length of each motor, mm.
    step_mm: [f32; 4],
    /// Largest difference between a block's travel along X, Y and Z and that of its steps, mm.
    slack_mm: [f32; 3],
}

impl StepSizes {
    pub fn new(geometry: &Geometry) -> Self {
        let step_mm = geometry.steps_per_mm.map(|steps| 1.0 / steps.to_f64() as f32);
        let [first, second, third, _] = step_mm;
        Self { step_mm, slack_mm: slack(geometry.kinematics, [first, second, third]) }
    }
}

/// Largest error of the position along each axis if each motor has this error.
fn slack(kinematics: Kinematics, [first, second, third]: [f32; 3]) -> [f32; 3] {
    let mut slack = [0.0; 3];
    for alone in [[first, 0.0, 0.0], [0.0, second, 0.0], [0.0, 0.0, third]] {
        for (axis, off) in slack.iter_mut().zip(kinematics.position(alone)) {
            *axis += off.abs();
        }
    }
    slack
}

/// Limits of a machine for blocks of steps.
pub(super) struct StepLimits<'a> {
    sizes: &'a StepSizes,
    kinematics: Kinematics,
    minimum_event_interval_ticks: f32,
    method: Method,
    max_feed_mm_per_s: [f32; 4],
    max_acceleration_mm_per_s2: [f32; 4],
    /// Largest acceleration along any path, mm/s^2.
    path_acceleration_mm_per_s2: f32,
    junction_deviation_mm: f32,
}

impl<'a> StepLimits<'a> {
    pub fn new(sizes: &'a StepSizes, limits: &Limits, geometry: &Geometry, choice: &MotionChoice) -> Self {
        let (print, travel) = (limits.print_acceleration_mm_per_s2, limits.travel_acceleration_mm_per_s2);
        Self {
            sizes,
            kinematics: geometry.kinematics,
            minimum_event_interval_ticks: geometry.minimum_event_interval_ticks as f32,
            method: Method::new(choice, geometry.kinematics),
            max_feed_mm_per_s: limits.max_feed_mm_per_s.map(|limit| limit as f32),
            max_acceleration_mm_per_s2: limits.max_acceleration_mm_per_s2.map(|limit| limit as f32),
            path_acceleration_mm_per_s2: print.max(travel).max(limits.retract_acceleration_mm_per_s2) as f32,
            junction_deviation_mm: limits.junction_deviation_mm as f32,
        }
    }

    /// Travel of a block along X, Y, Z and the filament, mm.
    fn travels_mm(&self, block: &Block) -> [f32; 4] {
        let step_mm = self.sizes.step_mm;
        let [first, second, third] = block.steps.map(|steps| steps as f32);
        let motors_mm = [first * step_mm[0], second * step_mm[1], third * step_mm[2]];
        let [x, y, z] = self.kinematics.position(motors_mm);
        let filament = block.extruder_256ths as f32 * (step_mm[3] / 256.0);
        [x, y, z, filament]
    }

    /// Returns true if a block's nominal speed and acceleration keep the limits of all axes, and
    /// its events their minimum distance.
    pub fn are_kept(&self, block: &Block) -> bool {
        let mm = self.travels_mm(block);
        let length = block.length_10nm as f32 / UNITS_PER_MM as f32;
        let (feed, acceleration) = (block.nominal.mm_per_s_f32(), block.acceleration.mm_per_s2_f32());
        if acceleration > self.path_acceleration_mm_per_s2 * TOLERANCE {
            return false;
        }
        // The filament has fractions of steps.
        let [x, y, z] = self.sizes.slack_mm;
        let slack_mm = [x, y, z, self.sizes.step_mm[3] / 128.0];
        for axis in 0..4 {
            let travel = (mm[axis].abs() - slack_mm[axis]).max(0.0);
            if feed * travel > self.max_feed_mm_per_s[axis] * length * TOLERANCE
                || acceleration * travel > self.max_acceleration_mm_per_s2[axis] * length * TOLERANCE
            {
                return false;
            }
        }
        let densest = self.method.densest(block.steps) as f32;
        let densest = densest.max(block.extruder_256ths.unsigned_abs() as f32 / 256.0);
        let shortest_ticks = densest * self.minimum_event_interval_ticks;
        feed * shortest_ticks <= block.length_10nm as f32 * TICKS_PER_10NM_AT_1_MM_PER_S * TOLERANCE
    }

    /// Maximum speed in the corner before a block, by its steps and those of the block before: v^2
    /// = a R as for any corner (Yu 2019), with the turn taken as small as half a step at each end
    /// can make it look. A stop next to a block of filament alone.
    pub fn corner(&self, before: Option<&Block>, block: &Block) -> Speed {
        let Some(before) = before else { return Speed(u32::MAX) };
        let lengths = [before, block].map(|block| block.length_10nm as f32 / UNITS_PER_MM as f32);
        let [one, other] = [before, block].map(|block| self.travels_mm(block));
        let stands = [before, block].map(|block| block.steps == [0; 3]);
        let [x, y, z, _] = self.sizes.step_mm;
        for (length, stands) in lengths.into_iter().zip(stands) {
            // A path without a step is shorter than a step of each of its motors: a longer one is
            // of filament alone. A shorter one may be either.
            if stands && length > (x + y + z) * TOLERANCE {
                return Speed::ZERO;
            }
        }
        let mut apart = 0.0;
        for axis in 0..3 {
            // Difference of unit vectors; each component is off by its slack at most.
            let slack = self.sizes.slack_mm[axis] / lengths[0] + self.sizes.slack_mm[axis] / lengths[1];
            let difference = (one[axis] / lengths[0] - other[axis] / lengths[1]).abs();
            let least = (difference - slack).max(0.0);
            apart += least * least;
        }
        // |u - w| = 2 sin(theta/2).
        let sine_squared = (apart / 4.0 / TOLERANCE).min(1.0);
        if sine_squared <= 1e-6 {
            return Speed(u32::MAX);
        }
        let (sine, cosine) = (square_root_f32(sine_squared), square_root_f32(1.0 - sine_squared));
        let within_deviation = self.junction_deviation_mm * cosine * (1.0 + cosine) / sine_squared;
        let fitting = 0.5 * lengths[0].min(lengths[1]) * cosine / sine;
        let acceleration = before.acceleration.mm_per_s2_f32().min(block.acceleration.mm_per_s2_f32());
        let squared_mm2_per_s2 = within_deviation.min(fitting) * acceleration * TOLERANCE;
        Speed::from_mm_per_s_f32(square_root_f32(squared_mm2_per_s2))
    }
}
