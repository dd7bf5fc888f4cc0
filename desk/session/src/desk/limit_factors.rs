//! Limits of another machine, for estimates.

use ferrostep_planner::Limits;

/// Factors of a plan's limits, powers of two: for estimates of another machine's time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitFactors {
    /// Factor of all accelerations.
    pub acceleration: f64,
    /// Factor of the deviation at corners.
    pub corners: f64,
}

impl Default for LimitFactors {
    /// The unchanged machine.
    fn default() -> Self {
        Self { acceleration: 1.0, corners: 1.0 }
    }
}

impl LimitFactors {
    /// The limits of a machine with these factors.
    pub(super) fn of(self, limits: Limits) -> Limits {
        let Self { acceleration, corners } = self;
        Limits {
            max_feed_mm_per_s: limits.max_feed_mm_per_s,
            max_acceleration_mm_per_s2: limits.max_acceleration_mm_per_s2.map(|axis| axis * acceleration),
            print_acceleration_mm_per_s2: limits.print_acceleration_mm_per_s2 * acceleration,
            travel_acceleration_mm_per_s2: limits.travel_acceleration_mm_per_s2 * acceleration,
            retract_acceleration_mm_per_s2: limits.retract_acceleration_mm_per_s2 * acceleration,
            junction_deviation_mm: limits.junction_deviation_mm * corners,
            instantaneous_corner_velocity_mm_per_s: limits.instantaneous_corner_velocity_mm_per_s,
        }
    }

    /// The factors that undo these.
    pub(super) const fn inverse(self) -> Self {
        Self { acceleration: 1.0 / self.acceleration, corners: 1.0 / self.corners }
    }
}
