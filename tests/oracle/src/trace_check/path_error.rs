//! Distance of the tool from the straight line of a move, in the plane of X and Y.

use super::law::MotorEvent;
use crate::reference::{Kinematics, ReferenceProfile};

/// Scale from whole steps of the motors to the tool's place in the plane.
#[derive(Clone, Copy, Debug)]
pub struct PlaneScale {
    kinematics: Kinematics,
    mm_per_step: [f64; 3],
}

impl PlaneScale {
    /// The scale of a profile.
    pub fn new(profile: &ReferenceProfile) -> Self {
        let [first, second, third, _] = profile.steps_per_mm.map(|steps| 1.0 / steps.to_f64());
        Self { kinematics: profile.kinematics, mm_per_step: [first, second, third] }
    }

    /// X and Y, mm.
    fn position_mm(&self, [first, second, third, _]: [i64; 4]) -> [f64; 2] {
        let steps = [first, second, third];
        let motors = std::array::from_fn(|motor| steps[motor] as f64 * self.mm_per_step[motor]);
        let [x, y, _] = self.kinematics.twice_the_tool(motors);
        [x / 2.0, y / 2.0]
    }

    /// Largest distance from the straight line between the motors' positions at both ends, mm;
    /// `None` if the move has no length in the plane.
    pub fn largest_error_mm(&self, start: [i64; 4], end: [i64; 4], events: &[MotorEvent]) -> Option<f64> {
        let ([x0, y0], [x1, y1]) = (self.position_mm(start), self.position_mm(end));
        let length_mm = (x1 - x0).hypot(y1 - y0);
        if length_mm == 0.0 {
            return None;
        }
        let mut motors = start;
        let mut largest = 0.0f64;
        for event in events {
            for (motor, step) in motors.iter_mut().zip(event.steps) {
                *motor += i64::from(step);
            }
            let [x, y] = self.position_mm(motors);
            largest = largest.max(((x - x0) * (y1 - y0) - (y - y0) * (x1 - x0)).abs() / length_mm);
        }
        Some(largest)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_beside_the_line_is_seen() {
        let events: Vec<_> = [[1, 1, 0, 0], [1, -1, 0, 0]].map(|steps| MotorEvent { tick: 0, steps }).to_vec();
        let cartesian = PlaneScale { kinematics: Kinematics::Cartesian, mm_per_step: [0.1; 3] };
        let error = cartesian.largest_error_mm([5, 7, 0, 0], [7, 7, 0, 0], &events).unwrap();
        assert!((error - 0.1).abs() < 1e-12);
        // Along x by one pulse, then along y: (1, 0) is beside the line to (1, 1).
        let core = PlaneScale { kinematics: Kinematics::CoreXy, mm_per_step: [0.1; 3] };
        let error = core.largest_error_mm([0; 4], [2, 0, 0, 0], &events).unwrap();
        assert!((error - 0.1 * 0.5f64.sqrt()).abs() < 1e-12);
        assert_eq!(core.largest_error_mm([1; 4], [1; 4], &events), None);
    }
}
