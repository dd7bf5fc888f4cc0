//! The machine used to plan the papers' examples.

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{Geometry, Kinematics, Limits, Planner, StepsPerMm};

use crate::Papers;

/// Creates a planner that sees `blocks` ahead, for a machine limited only by its acceleration,
/// mm/s^2, and Yu's delta, mm.
pub fn example_planner(
    acceleration_mm_per_s2: f64,
    deviation_mm: f64,
    blocks: usize,
) -> Option<Planner<Vec<Slot>, Papers>> {
    let steps_per_mm = StepsPerMm::from_f64(80.0)?;
    let geometry = Geometry {
        kinematics: Kinematics::Cartesian,
        steps_per_mm: [steps_per_mm; 4],
        minimum_event_interval_ticks: 84,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    };
    let limits = Limits {
        max_feed_mm_per_s: [500.0; 4],
        max_acceleration_mm_per_s2: [1e5; 4],
        print_acceleration_mm_per_s2: acceleration_mm_per_s2,
        travel_acceleration_mm_per_s2: acceleration_mm_per_s2,
        retract_acceleration_mm_per_s2: acceleration_mm_per_s2,
        junction_deviation_mm: deviation_mm,
        instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; 4],
    };
    Some(Planner::new(geometry, limits, vec![Slot::EMPTY; blocks]))
}
