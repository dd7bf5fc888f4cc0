//! One block's steps against its time law.

use super::deviation::Deviation;
use crate::reference::Trapezoid;

/// A step event by motor: -1, 0 or 1 for each.
#[derive(Clone, Copy, Debug)]
pub struct MotorEvent {
    /// Tick of the event.
    pub tick: u64,
    /// Step of each motor with its sign: 1, -1, or 0 for no step.
    pub steps: [i8; 4],
}

/// A block as it was traced, and the law it should follow.
pub struct TracedBlock<'a> {
    /// Source line.
    pub line: u32,
    /// Tick at which it begins.
    pub start_tick: u64,
    /// Tick at which it ends; later than `start_tick`.
    pub end_tick: u64,
    /// Positions of the motors at the start.
    pub start: [i64; 4],
    /// Positions of the motors at the start by the law, in steps.
    pub ideal_start: [f64; 4],
    /// Positions of the motors at the end by the law, in steps.
    pub ideal_end: [f64; 4],
    /// Step events, in order.
    pub events: &'a [MotorEvent],
    /// The law; its time is stretched to the block's duration.
    pub law: &'a Trapezoid,
    /// Ticks within which events may have been joined.
    pub event_interval_ticks: f64,
    /// Further distance that each motor is allowed, in steps: one for the step itself and a
    /// little for rounding.
    pub tolerance_steps: [f64; 4],
}

impl TracedBlock<'_> {
    /// Part of the way that the law has made at a tick, and its increase a tick there.
    pub fn part_at(&self, tick: u64) -> (f64, f64) {
        let seconds_per_tick = self.law.duration_s() / (self.end_tick - self.start_tick) as f64;
        let ticks = tick.saturating_sub(self.start_tick) as f64;
        let (position_mm, speed_mm_per_s) = self.law.at(ticks * seconds_per_tick);
        (position_mm / self.law.length_mm, speed_mm_per_s * seconds_per_tick / self.law.length_mm)
    }

    /// Deviation of each motor with the largest excess. A motor's position changes at its
    /// steps only and the law is monotone, so that only the moments before and after each
    /// step need a look.
    pub fn deviations(&self) -> [Option<Deviation>; 4] {
        let mut largest: [Option<Deviation>; 4] = [None; 4];
        let mut motors = self.start;
        for event in self.events {
            let (part, part_per_tick) = self.part_at(event.tick);
            for (motor, step) in event.steps.into_iter().enumerate().filter(|(_, step)| *step != 0) {
                let before = motors[motor];
                motors[motor] += i64::from(step);
                let distance = self.ideal_end[motor] - self.ideal_start[motor];
                let ideal = self.ideal_start[motor] + distance * part;
                let off = (before as f64 - ideal).abs().max((motors[motor] as f64 - ideal).abs());
                let joined = distance.abs() * part_per_tick * self.event_interval_ticks;
                let deviation = Deviation {
                    steps: off,
                    allowed_steps: self.tolerance_steps[motor] + joined,
                    line: self.line,
                    tick: event.tick,
                };
                keep_larger(&mut largest[motor], deviation);
            }
        }
        largest
    }
}

/// Keeps the deviation with the larger excess.
pub fn keep_larger(largest: &mut Option<Deviation>, deviation: Deviation) {
    if largest.is_none_or(|one| deviation.excess_steps() > one.excess_steps()) {
        *largest = Some(deviation);
    }
}
