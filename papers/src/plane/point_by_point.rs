//! Point-by-point comparison (CoreXY paper, method 1 and table 1).

use super::target::{PlaneError, Pulse, Target};

/// A line made of pulses along X or along Y.
///
/// The paper has four phases for each pulse: judge the deviation F, feed, recompute F, test for the
/// end. With (x, y) the pulses made and (X, Y) those of the whole line, all unsigned, F = X y - Y
/// x: above zero the point is on Y's side of the line.
///
/// - F >= 0: a pulse along X, F falls by Y;
/// - F < 0: a pulse along Y, F rises by X.
///
/// F stays between -Y and X - 1, so the point is less than a pulse from the line. The end test
/// counts pulses: after X + Y of them F is a multiple of X + Y, and in that range only 0 is, which
/// is the target. The paper's rule fails only if X = 0: F = 0 asks for a pulse along X at first,
/// and F + X never rises again. F starts at -1 in that case.
#[derive(Clone, Copy, Debug)]
pub struct PointByPoint {
    target: Target,
    /// F.
    deviation: i32,
    /// Number of remaining pulses.
    left: u32,
}

impl PointByPoint {
    /// Creates the line from 0 to (x, y) pulses, in either direction.
    ///
    /// # Errors
    /// [`PlaneError::NoLength`], [`PlaneError::TooLong`].
    pub fn new(x: i64, y: i64) -> Result<Self, PlaneError> {
        let target = Target::new(x, y)?;
        let [x, y] = target.magnitudes;
        Ok(Self { target, deviation: if x == 0 { -1 } else { 0 }, left: x + y })
    }
}

impl Iterator for PointByPoint {
    type Item = Pulse;

    #[inline]
    fn next(&mut self) -> Option<Pulse> {
        self.left = self.left.checked_sub(1)?;
        // Both are at most 2^28, and F is between them.
        let [x, y] = self.target.magnitudes.map(|pulses| pulses as i32);
        if self.deviation >= 0 {
            self.deviation -= y;
            Some(self.target.along_x())
        } else {
            self.deviation += x;
            Some(self.target.along_y())
        }
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.left as usize, Some(self.left as usize))
    }
}

impl ExactSizeIterator for PointByPoint {}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ferrostep_planner::bresenham::MAX_STEPS;
    use proptest::prelude::*;

    /// The points after each pulse.
    fn points(x: i64, y: i64) -> Vec<(i64, i64)> {
        let mut here = (0, 0);
        let step = |pulse: Pulse| {
            here = (here.0 + i64::from(pulse.x), here.1 + i64::from(pulse.y));
            here
        };
        PointByPoint::new(x, y).unwrap().map(step).collect()
    }

    #[test]
    fn the_paper_s_lines_are_walked() {
        // Figure 3, pulses of 0.1 mm.
        let flat = "xyxyxyxxyxyx";
        let steep = "xyyxyxyyxyxy";
        for ((x, y), expected) in [((7, 5), flat), ((5, 7), steep)] {
            let letters: String =
                PointByPoint::new(x, y).unwrap().map(|pulse| if pulse.x != 0 { 'x' } else { 'y' }).collect();
            assert_eq!(letters, expected, "{x} {y}");
        }
    }

    #[test]
    fn every_small_line_ends_at_its_end_and_stays_within_a_pulse() {
        for x in -40i64..=40 {
            for y in -40i64..=40 {
                if (x, y) == (0, 0) {
                    continue;
                }
                let points = points(x, y);
                assert_eq!(points.len() as i64, x.abs() + y.abs());
                assert_eq!(points.last(), Some(&(x, y)));
                // |X y - Y x| < sqrt(X^2 + Y^2): less than a pulse from the line.
                assert!(points.iter().all(|here| (x * here.1 - y * here.0).pow(2) < x * x + y * y || x * y == 0));
                assert!(x * y != 0 || points.iter().all(|here| x * here.1 == y * here.0), "{x} {y}");
            }
        }
    }

    #[test]
    fn what_is_no_line_is_refused() {
        assert_eq!(PointByPoint::new(0, 0).err(), Some(PlaneError::NoLength));
        let longest = i64::from(MAX_STEPS);
        for far in [longest + 1, 1 << 31, -(1 << 31), i64::MAX, i64::MIN] {
            assert_eq!(PointByPoint::new(far, 1).err(), Some(PlaneError::TooLong));
            assert_eq!(PointByPoint::new(0, far).err(), Some(PlaneError::TooLong));
        }
        assert_eq!(PointByPoint::new(longest, -longest).unwrap().len(), 1 << 29);
    }

    proptest! {
        #[test]
        fn long_lines_end_at_their_ends(x in -100_000i64..100_000, y in -100_000i64..100_000) {
            prop_assume!((x, y) != (0, 0));
            let points = points(x, y);
            prop_assert_eq!(points.last(), Some(&(x, y)));
            let squared = x * x + y * y;
            prop_assert!(points.iter().all(|here| (x * here.1 - y * here.0).pow(2) <= squared));
        }

        #[test]
        fn the_longest_lines_stay_in_range(x in MAX_STEPS - 9..=MAX_STEPS, y in MAX_STEPS - 9..=MAX_STEPS, flat in any::<bool>()) {
            let y = if flat { 1 } else { y };
            for mut line in [PointByPoint::new(x.into(), y.into()).unwrap(), PointByPoint::new(y.into(), x.into()).unwrap()] {
                for _ in 0..100_000 {
                    line.next();
                    prop_assert!(line.deviation.unsigned_abs() <= MAX_STEPS);
                }
            }
        }
    }
}
