//! Lines of several axes in any direction: the longest axis leads, and each of the others is
//! interpolated against it (Wu 2024, section 1).

use super::classic::Classic;
use super::decisions::Decisions;
use super::widths::Widths;
use ferrostep_planner::bresenham::{LineError, MAX_STEPS, Slope};

/// A straight line of `AXES` axes, at most 8, between two grid points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line<const AXES: usize> {
    /// Slope of each axis against the longest one.
    slopes: [Slope; AXES],
    /// Number of steps of the longest axis.
    steps: u32,
    /// Mask of the longest axis (bit i = axis i); the first one if several are longest.
    master: u8,
    /// Mask of the axes that run backwards (bit i = axis i).
    directions: u8,
}

impl<const AXES: usize> Line<AXES> {
    /// Creates the line with this displacement in steps, which may be 0 on some or all axes.
    ///
    /// # Errors
    /// An axis would make more than [`MAX_STEPS`] steps.
    pub fn new(displacement: [i64; AXES]) -> Result<Self, LineError> {
        const { assert!(0 < AXES && AXES <= 8) };
        let mut magnitudes = [0; AXES];
        let (mut steps, mut master, mut directions) = (0, 1, 0);
        for (axis, (magnitude, displacement)) in magnitudes.iter_mut().zip(displacement).enumerate() {
            *magnitude = u32::try_from(displacement.unsigned_abs()).map_err(|_| LineError::TooLong)?;
            if *magnitude > MAX_STEPS {
                return Err(LineError::TooLong);
            }
            directions |= u8::from(displacement < 0) << axis;
            if *magnitude > steps {
                (steps, master) = (*magnitude, 1 << axis);
            }
        }
        let mut slopes = [Slope::new(steps, 0)?; AXES];
        for (slope, magnitude) in slopes.iter_mut().zip(magnitudes) {
            *slope = Slope::new(steps, magnitude)?;
        }
        Ok(Self { slopes, steps, master, directions })
    }

    /// Creates the line between two points.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn between(from: [i64; AXES], to: [i64; AXES]) -> Result<Self, LineError> {
        let mut displacement = to;
        for (displacement, from) in displacement.iter_mut().zip(from) {
            *displacement = displacement.checked_sub(from).ok_or(LineError::TooLong)?;
        }
        Self::new(displacement)
    }

    /// Number of steps of the longest axis.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Mask of the axes that run backwards (bit i = axis i).
    pub fn directions(&self) -> u8 {
        self.directions
    }

    /// The line as stairs, with widths found by rule `W`.
    pub fn stairs<W: Widths>(&self) -> LineStairs<W, AXES> {
        let mut stairs = LineStairs { followers: self.slopes.map(Follower::new), usual: self.master, left: self.steps };
        for (axis, slope) in self.slopes.iter().enumerate() {
            stairs.usual |= u8::from(slope.is_steep()) << axis;
        }
        stairs
    }

    /// The line as points, by classic Bresenham. Points are relative to the start, which is not one
    /// of them.
    pub fn points<D: Decisions>(&self) -> Points<D, AXES> {
        Points {
            followers: self.slopes.map(Classic::new),
            master: self.master,
            directions: self.directions,
            at: [0; AXES],
            left: self.steps,
        }
    }
}

/// Consecutive events that step the same axes, except for the last event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineStair {
    /// Number of steps, at least 1.
    pub count: u32,
    /// Axes that step in each event, including the last unless they are in `differing`.
    pub axes: u8,
    /// Axes that do the opposite in the last event.
    pub differing: u8,
}

/// An axis interpolated against the longest; the longest itself is included.
#[derive(Clone, Copy, Debug)]
struct Follower<W> {
    widths: W,
    /// Remaining whole stairs, including the present one.
    whole: u32,
    /// Number of events up to the end of the present stair; out of reach after the last.
    left: u32,
}

impl<W: Widths> Follower<W> {
    fn new(slope: Slope) -> Self {
        let mut follower = Self { widths: W::new(slope), whole: slope.rarer() as u32, left: 0 };
        follower.begin_stair();
        follower
    }

    fn begin_stair(&mut self) {
        self.left = if self.whole > 0 { self.widths.width() } else { u32::MAX };
    }

    /// Passes `count` events, at most those left in the present stair; returns true if the stair
    /// ends with them.
    fn pass(&mut self, count: u32) -> bool {
        if self.whole == 0 {
            return false;
        }
        self.left = self.left.wrapping_sub(count);
        let ends = self.left == 0;
        if ends {
            self.whole = self.whole.wrapping_sub(1);
            self.begin_stair();
        }
        ends
    }
}

/// Stairs of a line: each ends with an event in which some axis deviates from its usual behaviour.
/// Their number is at most the sum of min(dy, dx - dy) over the axes other than the longest, plus
/// one.
#[derive(Clone, Copy, Debug)]
pub struct LineStairs<W, const AXES: usize> {
    followers: [Follower<W>; AXES],
    /// Axes that step in most events.
    usual: u8,
    /// Number of remaining events.
    left: u32,
}

impl<W: Widths, const AXES: usize> LineStairs<W, AXES> {
    /// Number of decision values compared so far.
    pub fn decisions(&self) -> u64 {
        self.followers.iter().map(|follower| follower.widths.decisions()).sum()
    }
}

impl<W: Widths, const AXES: usize> Iterator for LineStairs<W, AXES> {
    type Item = LineStair;

    fn next(&mut self) -> Option<LineStair> {
        let count = self.followers.iter().fold(self.left, |count, follower| count.min(follower.left));
        if count == 0 {
            return None;
        }
        self.left = self.left.wrapping_sub(count);
        let mut differing = 0;
        for (axis, follower) in self.followers.iter_mut().enumerate() {
            differing |= u8::from(follower.pass(count)) << axis;
        }
        Some(LineStair { count, axes: self.usual, differing })
    }
}

/// Points of a line after its start, up to and including the end.
#[derive(Clone, Copy, Debug)]
pub struct Points<D, const AXES: usize> {
    followers: [Classic<D>; AXES],
    master: u8,
    directions: u8,
    at: [i32; AXES],
    left: u32,
}

impl<D: Decisions, const AXES: usize> Points<D, AXES> {
    /// Number of decision values compared so far.
    pub fn decisions(&self) -> u64 {
        self.followers.iter().map(Classic::decisions).sum()
    }

    /// The axes that step next.
    pub fn next_axes(&mut self) -> Option<u8> {
        self.left = self.left.checked_sub(1)?;
        let mut axes = self.master;
        for (axis, follower) in self.followers.iter_mut().enumerate() {
            let bit = 1 << axis;
            if bit != self.master && follower.pass(1) {
                axes |= bit;
            }
        }
        Some(axes)
    }
}

impl<D: Decisions, const AXES: usize> Iterator for Points<D, AXES> {
    type Item = [i32; AXES];

    fn next(&mut self) -> Option<[i32; AXES]> {
        let axes = self.next_axes()?;
        for (axis, at) in self.at.iter_mut().enumerate() {
            let step = if self.directions >> axis & 1 == 0 { 1 } else { -1 };
            // The position stays within [`MAX_STEPS`] of zero.
            *at = at.wrapping_add(if axes >> axis & 1 == 0 { 0 } else { step });
        }
        Some(self.at)
    }
}
