//! Step ("staircase") Bresenham, Wu 2024.

/// Largest step count either axis of a line may have; keeps every decision value in 32 bits.
pub const MAX_STEPS: u32 = 1 << 28;

/// A line, walked by stairs: runs of major-axis steps, the last of each with a minor-axis step.
///
/// The points are those of classic Bresenham (Wu 2024, eq. 3). Wu finds the width of the next stair among 2n-2, 2n-1
/// and 2n, with n the width of the first (corollary 2), by comparisons instead of a division. A Cortex-M4 divides in 2
/// to 12 cycles, less than the comparisons take, and from any point of a stair; the corollary is tested.
#[derive(Clone, Copy, Debug)]
pub struct StepBresenham {
    /// 2 dy, by which the decision value rises with each step.
    rise: i32,
    /// 2 dx, by which it falls where the minor axis steps.
    fall: i32,
    /// Decision value of the last step, not above zero: the minor axis steps when it would be.
    decision: i32,
}

impl StepBresenham {
    /// The line of `major` by `minor` steps; `None` unless `minor <= major <=` [`MAX_STEPS`].
    pub const fn new(major: u32, minor: u32) -> Option<Self> {
        if minor > major || major > MAX_STEPS {
            return None;
        }
        let (dx, dy) = (major as i32, minor as i32);
        Some(Self { rise: 2 * dy, fall: 2 * dx, decision: -dx })
    }

    /// A line that never steps its minor axis.
    pub const fn level() -> Self {
        Self { rise: 0, fall: 0, decision: 0 }
    }

    /// What is left of the present stair: major-axis steps up to and including the next one with a minor-axis step, out
    /// of reach where there is none.
    #[inline]
    pub const fn width(&self) -> u32 {
        if self.rise == 0 {
            return u32::MAX;
        }
        // Neither is negative.
        (self.decision.wrapping_neg() as u32 / self.rise as u32).wrapping_add(1)
    }

    /// Passes `count` major-axis steps, at most [`Self::width`]; whether the minor axis steps with the last of them.
    #[inline(always)]
    pub const fn pass(&mut self, count: u32) -> bool {
        // At most the rise above zero, which fits, as `count` is at most the width.
        self.decision = self.decision.wrapping_add(self.rise.wrapping_mul(count as i32));
        let steps = self.decision > 0;
        if steps {
            self.decision = self.decision.wrapping_sub(self.fall);
        }
        steps
    }

    /// Major-axis steps, one after the other from the next on, with each of which the minor axis steps; out of reach where
    /// it does with all. The complement of a stair: on a line steeper than 1/2 these are most.
    #[inline]
    pub const fn diagonal(&self) -> u32 {
        let above = self.decision.wrapping_add(self.rise);
        if above <= 0 {
            return 0;
        }
        if self.fall == self.rise {
            return u32::MAX;
        }
        // By so much the decision value falls with each of them; neither is negative.
        let step = self.fall.wrapping_sub(self.rise) as u32;
        ((above - 1) as u32 / step).wrapping_add(1)
    }

    /// Passes `count` major-axis steps, at most [`Self::diagonal`].
    #[inline(always)]
    pub const fn pass_diagonal(&mut self, count: u32) {
        self.decision = self.decision.wrapping_add(self.rise.wrapping_sub(self.fall).wrapping_mul(count as i32));
    }

    /// The widths of the stairs still to come; the major-axis steps behind the last of them are the caller's.
    pub const fn stairs(self) -> Stairs {
        Stairs { left: self.rise as u32 / 2, line: self }
    }
}

/// The widths of a line's stairs, one for each minor-axis step.
#[derive(Clone, Copy, Debug)]
pub struct Stairs {
    line: StepBresenham,
    left: u32,
}

impl Iterator for Stairs {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        self.left = self.left.checked_sub(1)?;
        let width = self.line.width();
        self.line.pass(width);
        Some(width)
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
                let stairs: Vec<u32> = StepBresenham::new(dx, dy).unwrap().stairs().collect();
                assert_eq!(stairs, classic(i64::from(dx), i64::from(dy)), "{dx} {dy}");
            }
        }
    }

    #[test]
    fn widths_are_those_of_corollary_2() {
        for dx in 1..=300u32 {
            for dy in 1..=dx {
                let mut stairs = StepBresenham::new(dx, dy).unwrap().stairs();
                let n = stairs.next().unwrap();
                assert!(stairs.all(|width| (2 * n - 2..=2 * n).contains(&width)), "{dx} {dy}");
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
            let stairs: Vec<u32> = StepBresenham::new(dx, dy).unwrap().stairs().collect();
            prop_assert_eq!(stairs, classic(i64::from(dx), i64::from(dy)));
        }

        #[test]
        fn any_way_to_pass_gives_the_same_points(dx in 1u32..5_000, share in 0.0f64..=1.0, parts in proptest::collection::vec(1u32..50, 1..200)) {
            let dy = (f64::from(dx) * share) as u32;
            let mut at_once = StepBresenham::new(dx, dy).unwrap();
            let mut singly = at_once;
            let mut left = dx;
            for part in parts {
                let count = part.min(at_once.width()).min(left);
                let steps = (0..count).filter(|_| singly.pass(1)).count();
                prop_assert_eq!(usize::from(at_once.pass(count)), steps);
                left -= count;
            }
        }

        #[test]
        fn diagonals_are_the_same_points(dx in 1u32..5_000, share in 0.0f64..=1.0) {
            let dy = (f64::from(dx) * share) as u32;
            let mut line = StepBresenham::new(dx, dy).unwrap();
            let mut singly = line;
            let mut left = dx;
            while left > 0 {
                let diagonal = line.diagonal().min(left);
                line.pass_diagonal(diagonal);
                prop_assert!((0..diagonal).all(|_| singly.pass(1)));
                left -= diagonal;
                if left > 0 {
                    prop_assert!(!singly.pass(1) && !line.pass(1));
                    left -= 1;
                }
            }
        }

        #[test]
        fn the_longest_lines_stay_in_range(dx in MAX_STEPS - 1000..=MAX_STEPS, dy in 1u32..=1000) {
            let mut total = 0u64;
            let mut count = 0;
            for width in StepBresenham::new(dx, dy).unwrap().stairs() {
                total += u64::from(width);
                count += 1;
            }
            prop_assert!(count == dy && total <= u64::from(dx));
        }
    }
}
