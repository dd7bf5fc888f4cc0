//! The motors' places at times close together, and at the ends of moves, from their steps.

use std::collections::VecDeque;

use crate::motor::Motor;

/// Times of the sampler, in ticks.
#[derive(Clone, Copy, Debug)]
struct Times {
    /// Between samples: 1 ms.
    grid: u64,
    /// Steps further apart are a rest between them: 200 ms.
    rest: u64,
    /// Time in which a motor comes to its rest: 5 ms.
    settle: u64,
}

/// Places of the motors at a time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub tick: u64,
    /// Positions of the motors, steps.
    pub motors: [f64; 4],
    /// The line whose move ends here.
    pub ends: Option<u32>,
}

/// Takes steps and gives samples, later by the time in which a motor may rest.
#[derive(Debug)]
pub(crate) struct Sampler {
    motors: [Motor; 4],
    ends: VecDeque<(u64, u32)>,
    times: Times,
    last_tick: u64,
    due_tick: u64,
}

impl Sampler {
    pub fn new(tick_hz: u32) -> Self {
        let ms = u64::from(tick_hz) / 1000;
        let times = Times { grid: ms, rest: 200 * ms, settle: 5 * ms };
        Self { motors: Default::default(), ends: VecDeque::new(), times, last_tick: 0, due_tick: 2 * times.rest }
    }

    /// Takes a step event; returns whether samples are due.
    #[inline]
    pub fn step(&mut self, tick: u64, axes: u8, directions: u8) -> bool {
        for (bit, motor) in self.motors.iter_mut().enumerate() {
            if axes >> bit & 1 == 1 {
                motor.step(tick, if directions >> bit & 1 == 1 { -1 } else { 1 });
            }
        }
        tick > self.due_tick
    }

    /// A line's move ends at a tick.
    pub fn end_move(&mut self, tick: u64, line: u32) {
        self.ends.push_back((tick, line));
    }

    /// Whole steps of all motors.
    pub fn positions(&self) -> [i64; 4] {
        self.motors.each_ref().map(Motor::position)
    }

    /// Gives the motors other positions from now on. All samples have been taken.
    pub fn redefine(&mut self, tick: u64, positions: [i64; 4]) {
        for (motor, position) in self.motors.iter_mut().zip(positions) {
            motor.set_position(position);
        }
        self.last_tick = self.last_tick.max(tick);
    }

    /// The last tick up to which no step can be missing, at the time of the last event.
    pub const fn settled_tick(&self, tick: u64) -> u64 {
        tick.saturating_sub(self.times.rest)
    }

    /// The next sample, if it lies before or at `until`.
    pub fn next(&mut self, until: u64) -> Option<Sample> {
        let end = self.ends.front().copied();
        let grid_tick = self.last_tick + self.times.grid;
        let (tick, ends) = match end {
            // Two samples are never close together.
            Some((tick, line)) if tick <= grid_tick + self.times.grid / 4 => (tick.max(self.last_tick), Some(line)),
            _ => (grid_tick, None),
        };
        if tick > until {
            self.due_tick = until + 2 * self.times.rest;
            return None;
        }
        if ends.is_some() {
            self.ends.pop_front();
        }
        self.last_tick = tick;
        let Times { rest, settle, .. } = self.times;
        let motors = self.motors.each_mut().map(|motor| motor.at(tick, rest, settle));
        Some(Sample { tick, motors, ends })
    }
}
