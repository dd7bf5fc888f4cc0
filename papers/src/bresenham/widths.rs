//! Width of the next stair: Wu 2024's two corollaries.
//!
//! Below, e is the decision value after a stair's last step, dx the steps of the major axis and
//! dy those of the rarer kind (of the minor axis, or on a steep line of the major axis alone).
//! Each step adds 2 dy, and the first that brings the value above zero ends the stair and takes
//! off 2 dx. So -2 dx < e <= 2 dy - 2 dx after every stair, and a stair of width w ends with e +
//! 2 w dy, in (0, 2 dy].

use super::decisions::{Decisions, Uncounted};
use ferrostep_planner::bresenham::Slope;

/// A rule that finds the widths of a line's stairs in order.
pub trait Widths: Copy {
    /// Creates the state at the start of a line.
    fn new(slope: Slope) -> Self;

    /// Width of the next stair. There are as many stairs as steps of the rarer kind; beyond them,
    /// or without any, the width is meaningless.
    fn width(&mut self) -> u32;

    /// Number of decision values compared so far.
    fn decisions(&self) -> u64;
}

/// Widths without a division: from the width n of the first stair, found by counting (Wu
/// 2024, corollary 2).
///
/// The first stair starts at e = -dx, or 1 - dx on a steep line. Its width is the n with 2 (n - 1)
/// dy <= dx < 2 n dy, or 2 (n - 1) dy < dx <= 2 n dy. A stair after it of width w ends in (0, 2
/// dy], so (w - 1) dy < dx and w dy > dx - dy (from the bounds of e): with the former, w - 1 < 2 n
/// and w > 2 n - 3. The paper's d1, the value at width 2n-2, is e + 2 (2 n - 2) dy; it prints d0 +
/// 2 (dy - dx) + 2 (2 n - 3) dy, the same with e = d0 - 2 dx. Which of the widths it is, one
/// comparison tells or two.
#[derive(Clone, Copy, Debug)]
pub struct FromFirstStair<D = Uncounted> {
    rise: i32,
    fall: i32,
    /// e after the last stair handed out.
    decision: i32,
    /// 2n-2, and the change of the decision value over a stair of that width; `None` before the
    /// first stair.
    least: Option<(u32, i32)>,
    decisions: D,
}

impl<D: Decisions> FromFirstStair<D> {
    /// Counts the first stair.
    #[inline(always)]
    fn first(&mut self) -> u32 {
        if self.rise == 0 {
            return 0;
        }
        let mut width = 1u32;
        let mut value = self.decision.wrapping_add(self.rise);
        while !self.decisions.is_above_zero(value) {
            value = value.wrapping_add(self.rise);
            width = width.wrapping_add(1);
        }
        self.decision = value.wrapping_sub(self.fall);
        let least = width.wrapping_sub(1).wrapping_mul(2);
        self.least = Some((least, self.rise.wrapping_mul(least as i32)));
        width
    }
}

impl<D: Decisions> Widths for FromFirstStair<D> {
    #[inline(always)]
    fn new(slope: Slope) -> Self {
        let (rise, fall) = (slope.rarer().wrapping_mul(2), slope.dx().wrapping_mul(2));
        Self { rise, fall, decision: slope.start(), least: None, decisions: D::default() }
    }

    #[inline(always)]
    fn width(&mut self) -> u32 {
        let Some((least, run)) = self.least else { return self.first() };
        let mut width = least;
        let mut value = self.decision.wrapping_add(run);
        if !self.decisions.is_above_zero(value) {
            value = value.wrapping_add(self.rise);
            width = width.wrapping_add(1);
            if !self.decisions.is_above_zero(value) {
                value = value.wrapping_add(self.rise);
                width = width.wrapping_add(1);
            }
        }
        self.decision = value.wrapping_sub(self.fall);
        width
    }

    fn decisions(&self) -> u64 {
        self.decisions.count()
    }
}

/// Widths with one division a line: F = floor(dx/dy) (Wu 2024, corollary 1), for which an optimised
/// Cortex-M4 takes 2 to 12 cycles.
///
/// A stair of width w after the first: from e > -2 dx and the end at most 2 dy, w dy < dx + dy, so
/// w <= F + 1; from e <= 2 dy - 2 dx and the end above zero, w dy > dx - dy, so w >= F. At width F
/// the value is e + 2 F dy; the paper's d0 + 2 (dy - dx) + 2 (F + 1) dy would be at width F + 2 and
/// is a misprint of 2 (F - 1) dy.
///
/// The first stair starts dx nearer to its end, half as far as others: its width is half
/// of F, or one more.
#[derive(Clone, Copy, Debug)]
pub struct FromQuotient<D = Uncounted> {
    rise: i32,
    /// F of the next stair; half of it for the first.
    least: u32,
    /// F of all stairs but the first.
    quotient: u32,
    /// 2 dx - 2 F dy, by which a stair of width F lowers the decision value.
    lower: i32,
    /// The value at the next stair's width F.
    decision: i32,
    decisions: D,
}

impl<D: Decisions> Widths for FromQuotient<D> {
    #[inline(always)]
    fn new(slope: Slope) -> Self {
        let (dx, dy) = (slope.dx(), slope.rarer());
        let rise = dy.wrapping_mul(2);
        let quotient = (dx as u32).checked_div(dy as u32).unwrap_or(0);
        let run = rise.wrapping_mul(quotient as i32);
        let least = quotient / 2;
        let decision = slope.start().wrapping_add(rise.wrapping_mul(least as i32));
        Self { rise, least, quotient, lower: dx.wrapping_mul(2).wrapping_sub(run), decision, decisions: D::default() }
    }

    #[inline(always)]
    fn width(&mut self) -> u32 {
        let mut width = self.least;
        if !self.decisions.is_above_zero(self.decision) {
            self.decision = self.decision.wrapping_add(self.rise);
            width = width.wrapping_add(1);
        }
        // Decision value after the stair, and at width F of the next.
        self.decision = self.decision.wrapping_sub(self.lower);
        self.least = self.quotient;
        width
    }

    fn decisions(&self) -> u64 {
        self.decisions.count()
    }
}

/// Widths with one division per stair.
#[derive(Clone, Copy, Debug)]
pub struct FromDivision {
    rise: i32,
    fall: i32,
    /// e after the last stair.
    decision: i32,
}

impl Widths for FromDivision {
    #[inline(always)]
    fn new(slope: Slope) -> Self {
        Self { rise: 2 * slope.rarer(), fall: 2 * slope.dx(), decision: slope.start() }
    }

    #[inline(always)]
    fn width(&mut self) -> u32 {
        if self.rise == 0 {
            return u32::MAX;
        }
        // Neither operand is negative.
        let width = (self.decision.wrapping_neg() as u32 / self.rise as u32).wrapping_add(1);
        let end = self.decision.wrapping_add(self.rise.wrapping_mul(width as i32));
        self.decision = end.wrapping_sub(self.fall);
        width
    }

    /// Always 0: this rule neither divides nor compares.
    fn decisions(&self) -> u64 {
        0
    }
}
