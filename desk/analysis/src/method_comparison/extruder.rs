//! The extruder against lambda s(t), from the filament that the printer asked for and the path that
//! the other motors made.

use std::collections::VecDeque;

/// The times at which a move's path was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Tick at which it began.
    pub from_tick: u64,
    /// Ticks, in order, at which the nozzle had made a part of it, 0 to 1.
    pub passed: Vec<(u64, f64)>,
    /// Tick at which it ended.
    pub to_tick: u64,
}

impl Way {
    /// The part that the nozzle has made at a tick, evenly from one place to the next.
    fn part(&self, tick: u64) -> f64 {
        let behind = self.passed.partition_point(|(passed, _)| *passed <= tick);
        let (from, before) = behind.checked_sub(1).map_or((self.from_tick, 0.0), |index| self.passed[index]);
        let (to, after) = self.passed.get(behind).copied().unwrap_or((self.to_tick, 1.0));
        let share = if to > from { tick.saturating_sub(from) as f64 / (to - from) as f64 } else { 0.0 };
        before + (after - before) * share.min(1.0)
    }
}

/// Follows the extruder from the moves as they are planned and the steps as they are made.
#[derive(Default)]
pub struct Extruder {
    steps_per_mm: f64,
    /// Filament of the moves that have been planned and have not ended, 0.1 nm.
    planned_100pm: VecDeque<i64>,
    /// Filament of parts that lead to the next end of a move and have no filament themselves.
    open_100pm: i64,
    /// Planned position at the start of the present move, 0.1 nm, and the real one, steps.
    start_100pm: i64,
    steps: i64,
    /// Steps made in the present move, with their ticks.
    made: Vec<(u64, i64)>,
    farthest_off_steps: f64,
}

impl Extruder {
    /// An extruder at zero.
    pub fn new(steps_per_mm: f64) -> Self {
        Self { steps_per_mm, ..Self::default() }
    }

    /// A move has been planned after the others.
    pub fn planned(&mut self, filament_100pm: i64, ends_move: bool) {
        self.open_100pm += filament_100pm;
        if ends_move {
            self.planned_100pm.push_back(std::mem::take(&mut self.open_100pm));
        }
    }

    /// A move has been broken off; it must not push filament.
    pub fn broken_off(&mut self) {
        self.planned_100pm.clear();
        self.open_100pm = 0;
    }

    /// The extruder steps, 1 or -1.
    pub fn stepped(&mut self, tick: u64, step: i64) {
        self.made.push((tick, step));
    }

    /// The present move has ended. Without a path the extruder moved alone.
    pub fn move_ended(&mut self, way: Option<Way>) {
        let filament_100pm = self.planned_100pm.pop_front().unwrap_or(0);
        let steps_per_100pm = self.steps_per_mm / 1e7;
        for (tick, step) in self.made.drain(..) {
            if let Some(way) = &way {
                let ideal = (self.start_100pm as f64 + way.part(tick) * filament_100pm as f64) * steps_per_100pm;
                let off = (self.steps as f64 - ideal).abs().max(((self.steps + step) as f64 - ideal).abs());
                self.farthest_off_steps = self.farthest_off_steps.max(off);
            }
            self.steps += step;
        }
        self.start_100pm += filament_100pm;
    }

    /// Greatest distance from lambda s(t), just before or just after one of its
    /// steps, in steps.
    pub fn farthest_off_steps(&self) -> f64 {
        self.farthest_off_steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 ticks at half the mean speed, then 100 at one and a half times it.
    fn way() -> Way {
        Way { from_tick: 1000, passed: vec![(1100, 0.25)], to_tick: 1200 }
    }

    /// Half a millimetre of filament at 10 steps/mm, pushed at these ticks.
    fn farthest_off(ticks: [u64; 5]) -> f64 {
        let mut extruder = Extruder::new(10.0);
        extruder.planned(2_000_000, false);
        extruder.planned(3_000_000, true);
        ticks.into_iter().for_each(|tick| extruder.stepped(tick, 1));
        extruder.move_ended(Some(way()));
        extruder.farthest_off_steps()
    }

    #[test]
    fn steps_in_the_middles_are_half_a_step_off() {
        let off = farthest_off([1040, 1107, 1133, 1160, 1187]);
        assert!((off - 0.5).abs() < 0.02, "{off}");
    }

    #[test]
    fn an_early_and_a_late_step_are_found() {
        let early = farthest_off([1008, 1107, 1133, 1160, 1187]);
        assert!((early - 0.9).abs() < 0.02, "{early}");
        let late = farthest_off([1040, 1107, 1133, 1160, 1200]);
        assert!((late - 1.0).abs() < 0.02, "{late}");
    }

    #[test]
    fn a_fraction_is_carried_to_the_next_move() {
        let mut extruder = Extruder::new(10.0);
        // 0.4 steps, then at a quarter of the way a step of 1.2.
        for (filament_100pm, ticks) in [(400_000, vec![]), (1_200_000, vec![1100])] {
            extruder.planned(filament_100pm, true);
            ticks.into_iter().for_each(|tick| extruder.stepped(tick, 1));
            extruder.move_ended(Some(way()));
        }
        assert!((extruder.farthest_off_steps() - 0.7).abs() < 1e-9);
    }

    #[test]
    fn a_retraction_and_homing_are_not_looked_at() {
        let mut extruder = Extruder::new(10.0);
        extruder.planned(0, true);
        extruder.broken_off();
        extruder.planned(-1_000_000, true);
        extruder.stepped(7, -1);
        extruder.move_ended(None);
        extruder.planned(1_000_000, true);
        extruder.stepped(1133, 1);
        extruder.move_ended(Some(way()));
        assert!((extruder.farthest_off_steps() - 0.5).abs() < 0.01, "{}", extruder.farthest_off_steps());
    }
}
