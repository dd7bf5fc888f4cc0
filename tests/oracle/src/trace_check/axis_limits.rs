//! Speed and acceleration of axes over sliding windows.
//!
//! Positions are in half steps, in which CoreXY's axes are whole numbers as well: x = A + B, y =
//! A - B. Each may be off by one step of each motor, two half steps, so that a distance is known to
//! four. The least value that fits the window is compared with a limit.

use super::law::MotorEvent;
use crate::reference::{Kinematics, Limits, ReferenceProfile};
use std::collections::VecDeque;

/// Steps in the windows for speed: a short one that sees short bursts, a long one that
/// measures finely.
const SPEED_WINDOWS: [usize; 2] = [20, 200];

/// Steps in each of the two windows whose speeds give an acceleration.
const ACCELERATION_WINDOW: usize = 100;

/// Steps between the places at which the acceleration is evaluated.
const ACCELERATION_STRIDE: usize = 10;

/// Maximum error of a distance between two samples, half steps.
const DISTANCE_SLACK: f64 = 4.0;

#[derive(Clone, Copy)]
struct Sample {
    tick: u64,
    half_steps: i64,
}

/// An axis beyond a limit.
#[derive(Clone, Copy, Debug)]
pub struct Excess {
    /// Index of the axis.
    pub axis: usize,
    /// Tick at the window's end.
    pub tick: u64,
    /// Minimum possible value / limit.
    pub ratio: f64,
}

/// Watches the axes of one machine.
pub struct AxisLimits {
    kinematics: Kinematics,
    half_steps_per_mm: [f64; 4],
    tick_hz: f64,
    /// Ticks by which each of two events may have moved.
    slack_ticks: f64,
    recent: [VecDeque<Sample>; 4],
}

impl AxisLimits {
    /// A watch for a machine whose events may be joined within `event_interval_ticks`.
    pub fn new(profile: &ReferenceProfile, tick_hz: u64, event_interval_ticks: f64) -> Self {
        Self {
            kinematics: profile.kinematics,
            half_steps_per_mm: profile.steps_per_mm.map(|steps| steps.to_f64() * 2.0),
            tick_hz: tick_hz as f64,
            slack_ticks: 2.0 * event_interval_ticks,
            recent: Default::default(),
        }
    }

    /// Forgets the windows: positions or limits have changed.
    pub fn restart(&mut self) {
        for recent in &mut self.recent {
            recent.clear();
        }
    }

    fn axes(&self, [a, b, c, e]: [i64; 4]) -> [i64; 4] {
        let [x, y, z] = self.kinematics.twice_the_tool([a, b, c]);
        [x, y, z, 2 * e]
    }

    /// Takes the motors' places after an event. Updates the largest ratios and returns the worst
    /// axis beyond its speed.
    pub fn speed(&mut self, tick: u64, motors: [i64; 4], limits: &Limits, ratios: &mut [f64; 4]) -> Option<Excess> {
        let mut worst: Option<Excess> = None;
        let axes = self.axes(motors);
        for (axis, recent) in self.recent.iter_mut().enumerate() {
            let half_steps = axes[axis];
            if recent.back().is_some_and(|last| last.half_steps == half_steps) {
                continue;
            }
            for window in SPEED_WINDOWS {
                let Some(from) = recent.len().checked_sub(window).and_then(|index| recent.get(index)) else { continue };
                let distance = (half_steps - from.half_steps).abs() as f64 - DISTANCE_SLACK;
                let ticks = tick.saturating_sub(from.tick) as f64 + self.slack_ticks;
                let limit = limits.max_feed_mm_per_s[axis] * self.half_steps_per_mm[axis] * ticks / self.tick_hz;
                let ratio = distance / limit;
                ratios[axis] = ratios[axis].max(ratio);
                if ratio > 1.0 && worst.is_none_or(|one| ratio > one.ratio) {
                    worst = Some(Excess { axis, tick, ratio });
                }
            }
            if recent.len() == SPEED_WINDOWS[1] {
                recent.pop_front();
            }
            recent.push_back(Sample { tick, half_steps });
        }
        worst
    }

    /// Checks the acceleration inside one block. Updates the largest ratios and
    /// returns the worst axis.
    ///
    /// With an acceleration of at most a, the mean speeds of two windows that follow each other
    /// differ by at most a times the time between the windows' middles.
    pub fn acceleration(
        &self,
        start: [i64; 4],
        events: &[MotorEvent],
        limits: &Limits,
        ratios: &mut [f64; 4],
    ) -> Option<Excess> {
        let mut samples: [Vec<Sample>; 4] = Default::default();
        let mut motors = start;
        for event in events {
            for (motor, step) in motors.iter_mut().zip(event.steps) {
                *motor += i64::from(step);
            }
            for (samples, half_steps) in samples.iter_mut().zip(self.axes(motors)) {
                if samples.last().is_none_or(|last| last.half_steps != half_steps) {
                    samples.push(Sample { tick: event.tick, half_steps });
                }
            }
        }
        let mut worst: Option<Excess> = None;
        for (axis, samples) in samples.iter().enumerate() {
            let limit = limits.max_acceleration_mm_per_s2[axis] * self.half_steps_per_mm[axis];
            for window in samples.windows(2 * ACCELERATION_WINDOW + 1).step_by(ACCELERATION_STRIDE) {
                let (first, middle, last) = (window[0], window[ACCELERATION_WINDOW], window[2 * ACCELERATION_WINDOW]);
                let mean = |from: Sample, to: Sample| {
                    let seconds = to.tick.saturating_sub(from.tick) as f64 / self.tick_hz;
                    (seconds, (to.half_steps - from.half_steps) as f64 / seconds, DISTANCE_SLACK / seconds)
                };
                let (first_s, first_speed, first_slack) = mean(first, middle);
                let (last_s, last_speed, last_slack) = mean(middle, last);
                let change = (last_speed - first_speed).abs() - first_slack - last_slack;
                let ratio = change / (limit * (first_s + last_s) / 2.0);
                ratios[axis] = ratios[axis].max(ratio);
                if ratio > 1.0 && worst.is_none_or(|one| ratio > one.ratio) {
                    worst = Some(Excess { axis, tick: last.tick, ratio });
                }
            }
        }
        worst
    }
}
