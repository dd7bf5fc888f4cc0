//! The extruder against lambda s(t): as the trace has it, and as it would be if it stepped with
//! the leading motor.
//!
//! Most firmware does the second; here it is a baseline. A block's extruder steps are those
//! from one rounded position to the next, and Bresenham's classic algorithm picks the steps of
//! the block's leading motor at which they are made. The baseline is made from the same trace,
//! at the leading motor's own step times, so that both are of the same blocks and are compared
//! with the same law.

use super::law::TracedBlock;
use std::fmt;

/// Index of the extruder.
const EXTRUDER: usize = 3;

/// Distances from lambda s(t), extruder steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distances {
    /// The maximum, just before or just after a step.
    pub largest_steps: f64,
    /// Source line of the block in which that is.
    pub largest_line: u32,
    sum_steps: f64,
    count: u64,
}

impl Distances {
    /// The mean over the nozzle's way: just before and just after each step of the leading motor.
    /// 0.25 for steps that are spaced evenly and are where lambda s passes their middle.
    pub fn mean_steps(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.sum_steps / self.count as f64 }
    }

    fn reach(&mut self, off_steps: f64, line: u32) {
        if off_steps.abs() > self.largest_steps {
            (self.largest_steps, self.largest_line) = (off_steps.abs(), line);
        }
    }

    fn add(&mut self, off_steps: f64) {
        self.sum_steps += off_steps.abs();
        self.count += 1;
    }
}

/// Distances of both extruders, over all blocks that push or draw filament on their way.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Extrusion {
    /// Blocks that were looked at.
    pub blocks: u64,
    /// Blocks whose leading motor is the extruder itself, which are left out: it waits
    /// for no other motor.
    pub led_by_the_extruder: u64,
    /// Steps of the extruder in the blocks that were looked at, as the trace has it,
    /// both directions.
    pub own_steps: u64,
    /// The same of the extruder that is slaved.
    pub slaved_steps: u64,
    /// The extruder as the trace has it.
    pub own: Distances,
    /// The extruder slaved to the leading motor.
    pub slaved: Distances,
}

/// Bresenham's classic algorithm as step interrupts run it: called at each of the leading motor's
/// steps, it says whether the follower steps as well.
#[derive(Clone, Copy, Debug)]
pub struct Slave {
    leader_steps: i64,
    follower_steps: i64,
    error: i64,
}

impl Slave {
    /// A follower that makes this many steps, not below zero and no more than the leading motor's,
    /// while that makes its own.
    pub fn new(leader_steps: i64, follower_steps: i64) -> Self {
        Self { leader_steps, follower_steps, error: -leader_steps }
    }

    /// Returns true if the follower steps with the leading motor's next step.
    pub fn steps(&mut self) -> bool {
        self.error += 2 * self.follower_steps;
        let steps = self.error >= 0;
        if steps {
            self.error -= 2 * self.leader_steps;
        }
        steps
    }
}

impl Extrusion {
    /// Adds a block.
    pub fn block(&mut self, block: &TracedBlock<'_>) {
        let totals: [i64; 4] = [0, 1, 2, 3].map(|motor| {
            let steps = |event: &super::law::MotorEvent| i64::from(event.steps[motor].unsigned_abs());
            block.events.iter().map(steps).sum()
        });
        // Any of the motors that step alike is the leading one.
        let leader = (0..EXTRUDER).max_by_key(|motor| totals[*motor]).unwrap_or(0);
        let (start, end) = (block.ideal_start[EXTRUDER], block.ideal_end[EXTRUDER]);
        if start == end || totals[leader] == 0 {
            return;
        }
        // Steps of the slaved extruder: from one rounded position to the next.
        let mut slaved = start.round() as i64;
        let due = end.round() as i64 - slaved;
        if due.abs() > totals[leader] {
            self.led_by_the_extruder += 1;
            return;
        }
        self.blocks += 1;
        let mut slave = Slave::new(totals[leader], due.abs());
        let mut own = block.start[EXTRUDER];
        for event in block.events {
            let ideal = start + (end - start) * block.part_at(event.tick).0;
            let off = |steps: i64| steps as f64 - ideal;
            let leads = event.steps[leader] != 0;
            let own_step = i64::from(event.steps[EXTRUDER]);
            let slaved_step = if leads && slave.steps() { due.signum() } else { 0 };
            for (distances, place, step) in [(&mut self.own, own, own_step), (&mut self.slaved, slaved, slaved_step)] {
                for place in [place, place + step] {
                    if step != 0 {
                        distances.reach(off(place), block.line);
                    }
                    if leads {
                        distances.add(off(place));
                    }
                }
            }
            own += own_step;
            slaved += slaved_step;
            self.own_steps += own_step.unsigned_abs();
            self.slaved_steps += slaved_step.unsigned_abs();
        }
    }
}

impl fmt::Display for Extrusion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = |name: &str, distances: &Distances| {
            let Distances { largest_steps, largest_line, .. } = distances;
            let mean = distances.mean_steps();
            format!(
                "{name} at most {largest_steps:.3} steps from lambda s (line {largest_line}), {mean:.3} in the mean"
            )
        };
        writeln!(formatter, "{}", line("extruder          ", &self.own))?;
        writeln!(formatter, "{}", line("the same by Bresenham", &self.slaved))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::Trapezoid;
    use crate::trace_check::law::MotorEvent;

    #[test]
    fn a_slave_makes_its_steps_in_the_middles() {
        let steps = |leader, follower| {
            let mut slave = Slave::new(leader, follower);
            (0..leader).map(|_| if slave.steps() { '#' } else { '.' }).collect::<String>()
        };
        assert_eq!(steps(10, 2), "..#....#..");
        assert_eq!(steps(4, 4), "####");
        assert_eq!(steps(5, 0), ".....");
        assert_eq!(steps(7, 3), ".#.#.#.");
    }

    /// Some mm at constant speed, a step of x each tick, from a place of the extruder to another;
    /// `own` tells at which events the extruder steps.
    fn straight(x_steps: u64, extruder: [f64; 2], own: impl Fn(u64) -> bool) -> Extrusion {
        let law = Trapezoid::new(1.0, 1.0, 1.0, 1.0, 1000.0);
        let direction = if extruder[1] < extruder[0] { -1 } else { 1 };
        let events: Vec<_> = (0..x_steps)
            .map(|index| MotorEvent { tick: 2 * index + 1, steps: [1, 0, 0, if own(index) { direction } else { 0 }] })
            .collect();
        let mut extrusion = Extrusion::default();
        extrusion.block(&TracedBlock {
            line: 7,
            start_tick: 0,
            end_tick: 2 * x_steps,
            start: [0, 0, 0, extruder[0].round() as i64],
            ideal_start: [0.0, 0.0, 0.0, extruder[0]],
            ideal_end: [x_steps as f64, 0.0, 0.0, extruder[1]],
            events: &events,
            law: &law,
            event_interval_ticks: 0.0,
            tolerance_steps: [1.0; 4],
        });
        extrusion
    }

    #[test]
    fn an_extruder_from_whole_step_to_whole_step_is_the_same_either_way() {
        for [from, to] in [[0.0, 10.0], [10.0, 0.0]] {
            let found = straight(100, [from, to], |index| index % 10 == 5);
            assert_eq!((found.blocks, found.own_steps, found.slaved_steps), (1, 10, 10));
            assert!((found.slaved.largest_steps - 0.55).abs() < 1e-9, "{found:?}");
            let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
            assert!(near(found.own.largest_steps, found.slaved.largest_steps), "{found:?}");
            assert!(near(found.own.mean_steps(), found.slaved.mean_steps()), "{found:?}");
            assert!((found.own.mean_steps() - 0.25).abs() < 0.02, "{found:?}");
        }
    }

    #[test]
    fn a_slave_from_rounded_positions_is_off_by_up_to_a_step() {
        // It lags half a step at the start, and its next step is due in the middle of the block.
        let found = straight(100, [0.49, 1.49], |index| index == 1);
        assert_eq!((found.own_steps, found.slaved_steps), (1, 1));
        assert!(found.own.largest_steps < 0.52 && found.slaved.largest_steps > 0.98, "{found:?}");
        assert_eq!(found.slaved.largest_line, 7);
        assert!(found.slaved.mean_steps() > found.own.mean_steps(), "{found:?}");
        // An extruder that is late is found as well.
        let late = straight(100, [0.49, 1.49], |index| index == 99);
        assert!(late.own.largest_steps > 1.4, "{late:?}");
    }

    #[test]
    fn what_the_extruder_leads_or_leaves_alone_is_not_looked_at() {
        assert_eq!(straight(10, [0.0, 11.0], |_| true), Extrusion { led_by_the_extruder: 1, ..Extrusion::default() });
        assert_eq!(straight(10, [1.25, 1.25], |_| false), Extrusion::default());
    }
}
