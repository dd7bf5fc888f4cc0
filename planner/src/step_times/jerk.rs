//! Steps at a constant jerk.

use crate::cubic::Cubic;
use crate::real::Real;

/// Steps from where the acceleration is zero, nearer than which each step's time is
/// worked out from there.
const NEAR: f32 = 8.0;

/// Share of a step's deviation from the path that the next interval corrects. Rounding makes a hair
/// of deviation with each step; correcting all of it would put the rounding of the absolute time
/// into the interval.
const CORRECTION: f32 = 1.0 / 16.0;

/// Half of an S-curve's ramp, in steps: `linear x + cubic x^3` of them up to the share x of its
/// duration, counted from where the acceleration is zero.
#[derive(Clone, Copy, Debug)]
pub(super) struct JerkSteps {
    curve: Cubic<f32>,
    /// Duration of the half, time units, and its reciprocal.
    half_time: f32,
    per_half_time: f32,
    /// Time units between the next step and where the acceleration is zero.
    time: u64,
    /// Steps from there at index 0, and the next step's index.
    base: f32,
    index: u32,
    /// 1 away from there, -1 as a wrapping number towards it.
    direction: u32,
}

impl JerkSteps {
    /// Steps on a curve in units of steps: the next one, of this number, is `time` units from where
    /// the acceleration is zero, and the step of number 0 is `base` steps from there.
    pub(super) fn new<F: Real>(curve: &Cubic<F>, half_time: F, time: F, base: F, index: u32, direction: u32) -> Self {
        Self {
            curve: Cubic { linear: curve.linear.to_f32(), cubic: curve.cubic.to_f32() },
            half_time: half_time.to_f32(),
            per_half_time: (F::from_u32(1) / half_time).to_f32(),
            time: time.to_u64(),
            base: base.to_f32(),
            index,
            direction,
        }
    }

    /// Advances to the next step; returns how long it takes, in time units.
    ///
    /// The time from where the acceleration is zero is a whole number, so that intervals add up
    /// without rounding. From it follow speed v and acceleration, and from those, by two of
    /// Newton's steps from 1/v, the interval in which one step is made.
    pub(super) fn units(&mut self) -> u64 {
        self.index = self.index.wrapping_add(self.direction);
        let distance = self.base + self.index as f32;
        let is_leaving = self.direction == 1;
        let before = self.time;
        if distance < NEAR {
            self.time = (self.curve.solve_f32(distance) * self.half_time).to_u64();
            return if is_leaving { self.time.saturating_sub(before) } else { before.saturating_sub(self.time) };
        }
        let x = before as f32 * self.per_half_time;
        let Cubic { linear, cubic } = self.curve;
        let signed = if is_leaving { 3.0 * cubic * x } else { -3.0 * cubic * x };
        let speed = linear + 3.0 * cubic * x * x;
        let mut share = 1.0 / speed;
        for _ in 0..2 {
            let path = share * (speed + share * (signed + cubic * share));
            share -= (path - 1.0) / (speed + share * (signed + signed + 3.0 * cubic * share));
        }
        let there = if is_leaving { x + share } else { x - share };
        let missing = (distance - self.curve.at(there)) / speed * CORRECTION;
        let share = if is_leaving { share + missing } else { share - missing };
        let units = (share * self.half_time + 0.5).to_u64();
        self.time = if is_leaving { before.saturating_add(units) } else { before.saturating_sub(units) };
        units
    }
}
