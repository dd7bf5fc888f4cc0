//! Several motors that lift Z, each at its place: they tilt what they lift.
//!
//! Two motors tilt along the line between them, three make a plane. Four would twist a frame, which
//! has no single plane: left out. Only the first motor, the axis's own, moves a switch along Z and
//! meets the frame's ends.

/// The motors that lift Z.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Lift {
    /// Index among the machine's motors, and X and Y in mm; the axis's own first.
    motors: Vec<(usize, [f64; 2])>,
}

impl Lift {
    /// Motors at their places.
    ///
    /// # Errors
    /// There are not two or three, or they have no line or plane.
    pub fn new(motors: Vec<(usize, [f64; 2])>) -> Result<Self, String> {
        let lift = Self { motors };
        match *lift.motors.as_slice() {
            [(_, a), (_, b)] if distance(a, b) > 1.0 => Ok(lift),
            [(_, a), (_, b), (_, c)] if doubled_area(a, b, c).abs() > 1.0 => Ok(lift),
            ref motors => Err(format!(
                "{} motors lift Z at {motors:?}: expected two at different places, or three that are not on one line",
                motors.len()
            )),
        }
    }

    /// True if a motor lifts Z beside the axis's own.
    pub fn is_further(&self, motor: usize) -> bool {
        self.motors.iter().skip(1).any(|(further, _)| *further == motor)
    }

    /// Height of the lifted part at a place above that at the axis's own motor, by each
    /// motor's height: mm.
    pub fn raised_mm(&self, [x, y]: [f64; 2], height_mm: impl Fn(usize) -> f64) -> f64 {
        let own_mm = self.motors.first().map_or(0.0, |(motor, _)| height_mm(*motor));
        let more = |motor: usize| height_mm(motor) - own_mm;
        match *self.motors.as_slice() {
            [(_, a), (second, b)] => {
                let along = (x - a[0]) * (b[0] - a[0]) + (y - a[1]) * (b[1] - a[1]);
                more(second) * along / distance(a, b).powi(2)
            }
            [(_, a), (second, b), (third, c)] => {
                let whole = doubled_area(a, b, c);
                let place = [x, y];
                (more(second) * doubled_area(a, place, c) + more(third) * doubled_area(a, b, place)) / whole
            }
            _ => 0.0,
        }
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}

/// Twice the area of a triangle, below 0 if it is passed clockwise.
fn doubled_area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn close(found: f64, wanted: f64) {
        assert!((found - wanted).abs() < 1e-9, "{found}, {wanted}");
    }

    #[test]
    fn two_motors_tilt_along_their_line() {
        let lift = Lift::new(vec![(2, [0.0, 50.0]), (4, [200.0, 50.0])]).unwrap();
        let heights = |motor| if motor == 4 { 3.0 } else { 1.0 };
        for (place, raised) in [([0.0, 0.0], 0.0), ([200.0, 90.0], 2.0), ([50.0, 50.0], 0.5), ([-100.0, 7.0], -1.0)] {
            close(lift.raised_mm(place, heights), raised);
        }
        assert!(lift.is_further(4) && !lift.is_further(2));
    }

    #[test]
    fn three_motors_make_a_plane() {
        let lift = Lift::new(vec![(2, [10.0, 0.0]), (5, [300.0, -20.0]), (4, [120.0, 280.0])]).unwrap();
        let plane = |[x, y]: [f64; 2]| 0.7 + 0.01 * x - 0.004 * y;
        let heights = |motor| match motor {
            2 => plane([10.0, 0.0]),
            5 => plane([300.0, -20.0]),
            _ => plane([120.0, 280.0]),
        };
        for place in [[10.0, 0.0], [300.0, -20.0], [120.0, 280.0], [150.0, 150.0], [-40.0, 300.0]] {
            close(lift.raised_mm(place, heights), plane(place) - plane([10.0, 0.0]));
        }
    }

    #[test]
    fn motors_without_a_plane_are_refused() {
        for places in [vec![], vec![(2, [0.0; 2])], vec![(2, [0.0; 2]), (4, [0.0; 2])]] {
            assert!(Lift::new(places).is_err());
        }
        assert!(Lift::new(vec![(2, [0.0; 2]), (4, [50.0, 50.0]), (5, [90.0, 90.0])]).is_err());
        assert!(Lift::new((0..4).map(|n| (n, [n as f64 * 9.0, (n % 2) as f64 * 9.0])).collect()).is_err());
    }
}
