//! Minimum deviation (CoreXY paper, method 2 and table 2).

use super::target::{PlaneError, Pulse, Target};

/// A line made of pulses along its longer axis or diagonally.
///
/// Eight octants: with a the longer of |X| and |Y| and b the shorter, F = 2b - a at first.
///
/// - F >= 0: a diagonal pulse, F rises by 2 (b - a);
/// - F < 0: a pulse along the longer axis, F rises by 2b.
///
/// The rule is Bresenham's except for ties: where the line passes midway between two points, Wu
/// 2024 (eq. 3) stays on the longer axis and this rule goes diagonally. The points of one are the
/// points of the other walked backwards.
#[derive(Clone, Copy, Debug)]
pub struct MinimumDeviation {
    target: Target,
    /// F.
    deviation: i32,
    /// Number of remaining pulses.
    left: u32,
    longer: u32,
    shorter: u32,
}

impl MinimumDeviation {
    /// Creates the line from 0 to (x, y) pulses, in either direction.
    ///
    /// # Errors
    /// [`PlaneError::NoLength`], [`PlaneError::TooLong`].
    pub fn new(x: i64, y: i64) -> Result<Self, PlaneError> {
        let target = Target::new(x, y)?;
        let [x, y] = target.magnitudes;
        let (longer, shorter) = (x.max(y), x.min(y));
        Ok(Self { target, deviation: 2 * shorter as i32 - longer as i32, left: longer, longer, shorter })
    }
}

impl Iterator for MinimumDeviation {
    type Item = Pulse;

    #[inline]
    fn next(&mut self) -> Option<Pulse> {
        self.left = self.left.checked_sub(1)?;
        // Both are at most 2^28, and so is F before twice b is added.
        let (longer, shorter) = (self.longer as i32, self.shorter as i32);
        if self.deviation >= 0 {
            self.deviation += 2 * (shorter - longer);
            return Some(self.target.diagonally());
        }
        self.deviation += 2 * shorter;
        let [x, y] = self.target.magnitudes;
        Some(if x >= y { self.target.along_x() } else { self.target.along_y() })
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.left as usize, Some(self.left as usize))
    }
}

impl ExactSizeIterator for MinimumDeviation {}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ferrostep_planner::bresenham::{MAX_STEPS, StepBresenham};
    use proptest::prelude::*;

    /// The points after each pulse.
    fn points(x: i64, y: i64) -> Vec<(i64, i64)> {
        let mut here = (0, 0);
        let step = |pulse: Pulse| {
            here = (here.0 + i64::from(pulse.x), here.1 + i64::from(pulse.y));
            here
        };
        MinimumDeviation::new(x, y).unwrap().map(step).collect()
    }

    /// Points by Bresenham, from the target back to 0.
    fn bresenham_backwards(x: i64, y: i64) -> Vec<(i64, i64)> {
        let (longer, shorter) = (x.abs().max(y.abs()), x.abs().min(y.abs()));
        let mut line = StepBresenham::new(longer as u32, shorter as u32).unwrap();
        let mut down = 0;
        let mut points = vec![(x, y)];
        for along in 1..longer {
            down += i64::from(line.pass(1));
            let (far, near) = (longer - along, shorter - down);
            let (dx, dy) = if x.abs() >= y.abs() { (far, near) } else { (near, far) };
            points.push((dx * x.signum(), dy * y.signum()));
        }
        points.reverse();
        points
    }

    #[test]
    fn the_paper_s_lines_are_walked() {
        // Figure 5, pulses of 0.1 mm; a capital for a diagonal.
        for ((x, y), expected) in [((7, 4), "DxDxDxD"), ((4, 7), "DyDyDyD")] {
            let letter = |pulse: Pulse| match (pulse.x, pulse.y) {
                (_, 0) => 'x',
                (0, _) => 'y',
                _ => 'D',
            };
            assert_eq!(MinimumDeviation::new(x, y).unwrap().map(letter).collect::<String>(), expected);
        }
    }

    #[test]
    fn every_small_line_is_bresenham_s() {
        for x in -40i64..=40 {
            for y in -40i64..=40 {
                if (x, y) != (0, 0) {
                    assert_eq!(points(x, y), bresenham_backwards(x, y), "{x} {y}");
                }
            }
        }
    }

    #[test]
    fn what_is_no_line_is_refused() {
        assert_eq!(MinimumDeviation::new(0, 0).err(), Some(PlaneError::NoLength));
        for far in [i64::from(MAX_STEPS) + 1, 1 << 31, -(1 << 31), i64::MAX, i64::MIN] {
            assert_eq!(MinimumDeviation::new(far, 1).err(), Some(PlaneError::TooLong));
            assert_eq!(MinimumDeviation::new(0, far).err(), Some(PlaneError::TooLong));
        }
    }

    proptest! {
        #[test]
        fn long_lines_are_bresenham_s(x in -100_000i64..100_000, y in -100_000i64..100_000) {
            prop_assume!((x, y) != (0, 0));
            let points = points(x, y);
            prop_assert_eq!(points.last(), Some(&(x, y)));
            prop_assert_eq!(points, bresenham_backwards(x, y));
        }

        #[test]
        fn the_longest_lines_stay_in_range(x in MAX_STEPS - 9..=MAX_STEPS, y in MAX_STEPS - 9..=MAX_STEPS, flat in any::<bool>()) {
            let y = if flat { 1 } else { y };
            let mut line = MinimumDeviation::new((x).into(), -i64::from(y)).unwrap();
            for _ in 0..100_000 {
                line.next();
                prop_assert!(line.deviation.unsigned_abs() <= 2 * MAX_STEPS);
            }
        }
    }
}
