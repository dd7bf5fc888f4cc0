//! How fast a corner may be taken.

use crate::square_root::square_root;

/// The corner between two straight moves.
#[derive(Clone, Copy, Debug)]
pub struct Corner {
    /// Unit vector of the move before.
    pub before: [f64; 3],
    /// Unit vector of the move after.
    pub after: [f64; 3],
    /// Length of the shorter of the two, mm.
    pub shorter_mm: f64,
}

impl Corner {
    /// Radius, mm, of the arc that rounds the corner; infinite when the moves are in line, 0 when they reverse.
    ///
    /// Yu 2019, fig. 2: the arc stays within `deviation_mm` of the corner,
    /// R = delta cos(theta/2) / (1 - cos(theta/2)), theta being the angle between the two directions. It must also
    /// fit: it touches each move at R tan(theta/2) from the corner, which may not pass the move's middle, so
    /// R <= (d/2) / tan(theta/2).
    pub fn radius_mm(&self, deviation_mm: f64) -> f64 {
        let cosine = self.before[0] * self.after[0] + self.before[1] * self.after[1] + self.before[2] * self.after[2];
        let cosine_half = square_root((1.0 + cosine) * 0.5);
        let sine_half = square_root((1.0 - cosine) * 0.5);
        let gap = 1.0 - cosine_half;
        if gap <= 0.0 || sine_half <= 0.0 {
            return f64::INFINITY;
        }
        let within_deviation = deviation_mm * cosine_half / gap;
        let fitting = 0.5 * self.shorter_mm * cosine_half / sine_half;
        within_deviation.min(fitting)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn corner(angle: f64, shorter_mm: f64) -> Corner {
        Corner { before: [1.0, 0.0, 0.0], after: [angle.cos(), angle.sin(), 0.0], shorter_mm }
    }

    #[test]
    fn straight_on_is_unbounded_and_reversal_stops() {
        assert_eq!(corner(0.0, 1.0).radius_mm(0.1), f64::INFINITY);
        assert!(corner(core::f64::consts::PI, 1.0).radius_mm(0.1) < 1e-8);
    }

    #[test]
    fn a_right_angle_of_long_moves_keeps_the_deviation() {
        let radius = corner(core::f64::consts::FRAC_PI_2, 100.0).radius_mm(0.1);
        // The arc's distance from the corner is R (1/cos(theta/2) - 1).
        assert!((radius * (2f64.sqrt() - 1.0) - 0.1).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_arc_stays_within_deviation_and_fits(angle in 0.001f64..3.1, shorter in 0.01f64..50.0, deviation in 0.001f64..1.0) {
            let radius = corner(angle, shorter).radius_mm(deviation);
            prop_assert!(radius * (1.0 / (angle / 2.0).cos() - 1.0) <= deviation * (1.0 + 1e-6));
            prop_assert!(radius * (angle / 2.0).tan() <= shorter / 2.0 * (1.0 + 1e-9));
        }
    }
}
