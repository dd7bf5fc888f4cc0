//! The speeds of a way without filament.

use super::LEAST_STAGE_S;
use crate::limits::{larger, smaller};
use crate::square_root::square_root_f32;

/// A travel of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    pub length_mm: f32,
    pub feed_mm_per_s: f32,
    pub acceleration_mm_per_s2: f32,
    /// The speed in the corner before it.
    pub entry_mm_per_s: f32,
}

impl Leg {
    pub const NONE: Self =
        Self { length_mm: 0.0, feed_mm_per_s: 1.0, acceleration_mm_per_s2: 1.0, entry_mm_per_s: 0.0 };

    /// The speed that is reached over its length from this one, or from which it
    /// brakes to this one.
    fn most_mm_per_s(&self, other_mm_per_s: f32) -> f32 {
        let squared = other_mm_per_s * other_mm_per_s + 2.0 * self.acceleration_mm_per_s2 * self.length_mm;
        smaller(self.feed_mm_per_s, square_root_f32(squared))
    }
}

/// Lowers the speeds in the corners to those that can be reached, and from which the last
/// leg comes to rest.
pub fn join(legs: &mut [Leg]) {
    let mut exit_mm_per_s = 0.0;
    for leg in legs.iter_mut().rev() {
        leg.entry_mm_per_s = smaller(leg.entry_mm_per_s, leg.most_mm_per_s(exit_mm_per_s));
        exit_mm_per_s = leg.entry_mm_per_s;
    }
    let mut reached_mm_per_s = f32::MAX;
    for leg in legs {
        leg.entry_mm_per_s = smaller(leg.entry_mm_per_s, reached_mm_per_s);
        reached_mm_per_s = leg.most_mm_per_s(leg.entry_mm_per_s);
    }
}

/// The legs between two stops, in the direction of time or against it.
#[derive(Clone, Copy, Debug)]
pub struct Way<'a> {
    pub legs: &'a [Leg],
    /// Duration as a multiple of the shortest that the legs allow.
    pub slowness: f32,
    pub is_backwards: bool,
}

/// Speed along a leg: a ramp, an even part, a ramp.
#[derive(Clone, Copy, Debug)]
pub struct Course {
    pub length_mm: f32,
    pub acceleration_mm_per_s2: f32,
    /// Speeds at its start, at its peak and at its end.
    pub begin_mm_per_s: f32,
    pub peak_mm_per_s: f32,
    pub end_mm_per_s: f32,
    /// The filament's proportion to the path changes at its start and its end, whatever the speed.
    pub begins_apart: bool,
    pub ends_apart: bool,
    /// Times at which the first ramp ends, the last one begins, and the leg ends, s.
    pub up_s: f32,
    pub even_s: f32,
    pub duration_s: f32,
}

impl Way<'_> {
    /// Leg `number`, counted from 0 in the way's direction.
    pub fn course(&self, number: usize) -> Course {
        let leg_at = |index: Option<usize>| index.and_then(|index| self.legs.get(index)).copied().unwrap_or(Leg::NONE);
        let index = if self.is_backwards { self.legs.len().wrapping_sub(number + 1) } else { number };
        let (before, leg, next) = (leg_at(index.checked_sub(1)), leg_at(Some(index)), leg_at(index.checked_add(1)));
        let (entry, exit) = (leg.entry_mm_per_s / self.slowness, next.entry_mm_per_s / self.slowness);
        let (begin, end) = if self.is_backwards { (exit, entry) } else { (entry, exit) };
        let apart = [before, next].map(|other| other.acceleration_mm_per_s2 != leg.acceleration_mm_per_s2);
        let [begins_apart, ends_apart] = if self.is_backwards { [apart[1], apart[0]] } else { apart };
        let acceleration = leg.acceleration_mm_per_s2 / (self.slowness * self.slowness);
        let squares = begin * begin + end * end;
        let reached = square_root_f32(acceleration * leg.length_mm + 0.5 * squares);
        let peak = larger(smaller(leg.feed_mm_per_s / self.slowness, reached), larger(begin, end));
        let ramps_mm = (peak * peak - 0.5 * squares) / acceleration;
        let up_s = (peak - begin) / acceleration;
        let even_s = up_s + larger(leg.length_mm - ramps_mm, 0.0) / peak;
        Course {
            length_mm: leg.length_mm,
            acceleration_mm_per_s2: acceleration,
            begin_mm_per_s: begin,
            peak_mm_per_s: peak,
            end_mm_per_s: end,
            begins_apart,
            ends_apart,
            up_s,
            even_s,
            duration_s: even_s + (peak - end) / acceleration,
        }
    }

    pub fn duration_s(&self) -> f32 {
        (0..self.legs.len()).fold(0.0, |sum, number| sum + self.course(number).duration_s)
    }
}

/// Phase of a leg's speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    Up,
    Even,
    Down,
}

impl Course {
    /// Phase from a time on; parts too short for a stage are skipped.
    pub fn phase(&self, time_s: f32) -> Phase {
        if time_s + LEAST_STAGE_S < self.up_s {
            Phase::Up
        } else if time_s + LEAST_STAGE_S < self.even_s {
            Phase::Even
        } else {
            Phase::Down
        }
    }

    /// The speed after so long.
    pub fn mm_per_s_after(&self, time_s: f32) -> f32 {
        let rising = self.begin_mm_per_s + self.acceleration_mm_per_s2 * time_s;
        let falling = self.end_mm_per_s + self.acceleration_mm_per_s2 * (self.duration_s - time_s);
        smaller(smaller(rising, falling), self.peak_mm_per_s)
    }

    /// The highest speed between two times.
    pub fn most_mm_per_s(&self, begin_s: f32, end_s: f32) -> f32 {
        if begin_s < self.even_s && end_s > self.up_s {
            return self.peak_mm_per_s;
        }
        larger(self.mm_per_s_after(begin_s), self.mm_per_s_after(end_s))
    }

    /// Distance covered after `time_s`, mm.
    pub fn mm_after(&self, time_s: f32) -> f32 {
        let ramp_mm = |from, time_s| time_s * (from + 0.5 * self.acceleration_mm_per_s2 * time_s);
        if time_s < self.up_s {
            ramp_mm(self.begin_mm_per_s, time_s)
        } else if time_s < self.even_s {
            ramp_mm(self.begin_mm_per_s, self.up_s) + self.peak_mm_per_s * (time_s - self.up_s)
        } else {
            self.length_mm - ramp_mm(self.end_mm_per_s, larger(self.duration_s - time_s, 0.0))
        }
    }
}
