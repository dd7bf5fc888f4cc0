//! Step ("staircase") Bresenham, Wu 2024.

/// Largest step count either axis of a line may have; keeps every decision value in 32 bits.
pub const MAX_STEPS: u32 = 1 << 28;

/// The stairs of a line: runs of major-axis steps, the last of each with a minor-axis step.
///
/// The points are those of classic Bresenham (Wu 2024, eq. 3). Every width between the first and the last is 2n-2,
/// 2n-1 or 2n, with n the width of the first (corollary 2); one or two comparisons choose among them. Iterating
/// yields one width for each minor-axis step; the major-axis steps after the last of them are the caller's.
#[derive(Clone, Copy, Debug)]
pub struct StepBresenham {
    major: i32,
    minor: i32,
    /// Minor-axis steps not yet handed out.
    left: i32,
    /// n, width of the first stair; 0 until it is handed out.
    first_width: i32,
    /// Decision value of the last step of the stair before.
    decision: i32,
}

impl StepBresenham {
    /// The line of `major` by `minor` steps; `None` unless `minor <= major <=` [`MAX_STEPS`].
    pub const fn new(major: u32, minor: u32) -> Option<Self> {
        if minor > major || major > MAX_STEPS {
            return None;
        }
        Some(Self { major: major as i32, minor: minor as i32, left: minor as i32, first_width: 0, decision: 0 })
    }

    /// A line that never steps its minor axis.
    pub const fn level() -> Self {
        Self { major: 0, minor: 0, left: 0, first_width: 0, decision: 0 }
    }
}

impl Iterator for StepBresenham {
    type Item = u32;

    #[inline]
    fn next(&mut self) -> Option<u32> {
        if self.left == 0 {
            return None;
        }
        self.left -= 1;
        let (dx, dy, n) = (self.major, self.minor, self.first_width);
        if n == 0 {
            // The first d_i = 2 i dy - dx above zero. Wu counts up to it; one division costs 12 cycles at most.
            let width = dx / (2 * dy) + 1;
            self.first_width = width;
            self.decision = 2 * dy * width - dx;
            return Some(width as u32);
        }
        let shortest = self.decision + 2 * (dy - dx) + 2 * (2 * n - 3) * dy;
        let (width, decision) = if shortest > 0 {
            (2 * n - 2, shortest)
        } else if shortest > -2 * dy {
            (2 * n - 1, shortest + 2 * dy)
        } else {
            (2 * n, shortest + 4 * dy)
        };
        self.decision = decision;
        Some(width as u32)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    /// Widths by Wu 2024 eq. 3, literally.
    fn classic(dx: i64, dy: i64) -> Vec<u32> {
        let mut decision = 2 * dy - dx;
        let mut widths = Vec::new();
        let mut width = 0;
        for _ in 0..dx {
            width += 1;
            if decision > 0 {
                widths.push(width);
                width = 0;
                decision += 2 * (dy - dx);
            } else {
                decision += 2 * dy;
            }
        }
        widths
    }

    #[test]
    fn every_small_line_equals_classic_bresenham() {
        for dx in 0..=300u32 {
            for dy in 0..=dx {
                let stairs: Vec<u32> = StepBresenham::new(dx, dy).unwrap().collect();
                assert_eq!(stairs, classic(i64::from(dx), i64::from(dy)), "{dx} {dy}");
            }
        }
    }

    #[test]
    fn a_line_too_long_or_too_steep_is_refused() {
        assert!(StepBresenham::new(3, 4).is_none());
        assert!(StepBresenham::new(MAX_STEPS + 1, 1).is_none());
        assert!(StepBresenham::new(MAX_STEPS, MAX_STEPS).is_some());
    }

    proptest! {
        #[test]
        fn long_lines_equal_classic_bresenham(dx in 1u32..200_000, share in 0.0f64..=1.0) {
            let dy = (f64::from(dx) * share) as u32;
            let stairs: Vec<u32> = StepBresenham::new(dx, dy).unwrap().collect();
            prop_assert_eq!(stairs, classic(i64::from(dx), i64::from(dy)));
        }

        #[test]
        fn the_longest_lines_stay_in_range(dx in MAX_STEPS - 1000..=MAX_STEPS, dy in 1u32..=1000) {
            let mut total = 0u64;
            let mut count = 0;
            for width in StepBresenham::new(dx, dy).unwrap() {
                total += u64::from(width);
                count += 1;
            }
            prop_assert!(count == dy && total <= u64::from(dx));
        }
    }
}
