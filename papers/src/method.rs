//! Demands of an interpolation method on planning: the number of events in a block, and their
//! spacing.

use ferrostep_planner::{DualRatePeriods, Interpolation, Kinematics, MotionChoice, TICKS_PER_SECOND};

use crate::plane::is_dead_zone;

/// An interpolation method other than step Bresenham, on a machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Method {
    pub interpolation: Interpolation,
    pub kinematics: Kinematics,
    periods: DualRatePeriods,
}

impl Method {
    /// Creates the chosen method.
    pub fn new(choice: &MotionChoice, kinematics: Kinematics) -> Self {
        // In the plane of X and Y the papers' methods support CoreXY's motors, or one motor for
        // each axis.
        let kinematics = if kinematics == Kinematics::CoreXy { kinematics } else { Kinematics::Cartesian };
        Self { interpolation: choice.interpolation, kinematics, periods: choice.dual_rate }
    }

    /// Unsigned motor steps of X and Y (or A and B).
    fn plane([x, y, _]: [i32; 3]) -> [u32; 2] {
        [x.unsigned_abs(), y.unsigned_abs()]
    }

    /// Returns true if the block's plane is interpolated at two rates.
    pub fn has_two_rates(&self, steps: [i32; 3]) -> bool {
        let [first, second] = Self::plane(steps);
        self.interpolation == Interpolation::DualRate && !is_dead_zone(&self.periods, first, second)
    }

    /// Number of equal parts of a block's path such that each part has at most one event of X, Y
    /// and Z's motors.
    pub fn densest(&self, steps: [i32; 3]) -> u32 {
        let [x, y] = Self::plane(steps);
        let longest = x.max(y);
        let plane = match self.interpolation {
            Interpolation::StepBresenham | Interpolation::Bresenham => longest,
            // Each pulse is an event; on CoreXY |X| + |Y| is the larger of |A| and |B|.
            Interpolation::PointByPoint if self.kinematics == Kinematics::Cartesian => x + y,
            Interpolation::PointByPoint => longest,
            _ if self.has_two_rates(steps) || self.kinematics == Kinematics::Cartesian => longest,
            // max(|X|, |Y|) = (|A| + |B|) / 2 pulses, a diagonal one in two halves.
            Interpolation::MinimumDeviation | Interpolation::DualRate => x + y,
        };
        let [.., z] = steps;
        plane.max(z.unsigned_abs())
    }

    /// Number of step events of X, Y and Z's motors in a block, including those that join others.
    pub fn events(&self, steps: [i32; 3]) -> u32 {
        let [x, y] = Self::plane(steps);
        let plane = match self.interpolation {
            Interpolation::StepBresenham | Interpolation::Bresenham => return self.densest(steps),
            Interpolation::PointByPoint if self.kinematics == Kinematics::Cartesian => x + y,
            _ if self.has_two_rates(steps) => x + y,
            // A pulse along an axis is one event on CoreXY and a diagonal is two: together the
            // larger of |A| and |B|.
            _ => x.max(y),
        };
        let [.., z] = steps;
        plane.saturating_add(z.unsigned_abs())
    }

    /// Minimum time for the block's X and Y, ticks: dual-rate runs no motor faster than T_min.
    pub fn least_ticks(&self, steps: [i32; 3]) -> f32 {
        /// Ticks per nanosecond.
        const TICKS_PER_NS: f32 = TICKS_PER_SECOND as f32 / 1e9;
        if self.interpolation != Interpolation::DualRate {
            return 0.0;
        }
        let [x, y] = Self::plane(steps);
        x.max(y) as f32 * (self.periods.shortest_ns as f32 * TICKS_PER_NS)
    }
}
