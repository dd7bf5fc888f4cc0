//! A motor's place between its steps.

use std::collections::VecDeque;

/// A step: its tick, and where the motor then passes, in half steps (always odd).
#[derive(Clone, Copy, Debug)]
struct Crossing {
    tick: u64,
    half_steps: i64,
}

/// A motor, whose place at any time is taken along straight lines from one step to the next: at the
/// tick of a step it passes midway between two whole steps.
#[derive(Debug, Default)]
pub(crate) struct Motor {
    /// Steps that have been taken and not passed by [`Self::at`], and the last one before.
    crossings: VecDeque<Crossing>,
    /// Whole steps after all crossings.
    position: i64,
    /// Whole steps before the first crossing that is kept.
    start: i64,
}

impl Motor {
    /// Takes a step, 1 or -1.
    #[inline]
    pub fn step(&mut self, tick: u64, direction: i64) {
        self.crossings.push_back(Crossing { tick, half_steps: 2 * self.position + direction });
        self.position += direction;
    }

    /// Whole steps after all that were taken.
    pub const fn position(&self) -> i64 {
        self.position
    }

    /// Sets another position from now on.
    pub fn set_position(&mut self, position: i64) {
        self.crossings.clear();
        (self.position, self.start) = (position, position);
    }

    /// The place at a tick, in steps; ticks must not go back. Where steps are further apart
    /// than `rest_ticks` the motor rests on a whole step between them, which it reaches
    /// within `settle_ticks`.
    pub fn at(&mut self, tick: u64, rest_ticks: u64, settle_ticks: u64) -> f64 {
        while self.crossings.get(1).is_some_and(|next| next.tick <= tick) {
            if let Some(passed) = self.crossings.pop_front() {
                // Half steps are odd: the whole step after a crossing lies on the other side of it
                // than the one before.
                self.start = passed.half_steps - self.start;
            }
        }
        let Some(&first) = self.crossings.front() else { return self.position as f64 };
        let (before, after, whole) = if first.tick <= tick {
            (Some(first), self.crossings.get(1).copied(), first.half_steps - self.start)
        } else {
            (None, Some(first), self.start)
        };
        let whole = whole as f64;
        let towards = |from: Crossing, ticks: u64| {
            let share = (ticks as f64 / settle_ticks as f64).min(1.0);
            from.half_steps as f64 * 0.5 * (1.0 - share) + whole * share
        };
        match (before, after) {
            (Some(before), Some(after)) if after.tick - before.tick <= rest_ticks => {
                let share = (tick - before.tick) as f64 / (after.tick - before.tick).max(1) as f64;
                0.5 * (before.half_steps as f64 * (1.0 - share) + after.half_steps as f64 * share)
            }
            (Some(before), Some(after)) if after.tick - tick < tick - before.tick => towards(after, after.tick - tick),
            (Some(before), _) => towards(before, tick - before.tick),
            (None, Some(after)) => towards(after, after.tick - tick),
            (None, None) => whole,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_steps_are_an_even_motion() {
        let mut motor = Motor::default();
        for step in 0..10 {
            motor.step(50 + step * 100, 1);
        }
        for tick in (50..=950).step_by(7) {
            let place = motor.at(tick, 1000, 100);
            assert!((place - tick as f64 / 100.0).abs() < 1e-9, "{tick}: {place}");
        }
        assert_eq!(motor.at(5000, 1000, 100), 10.0);
    }

    #[test]
    fn a_motor_that_turns_back_and_one_that_rests_stay_within_half_a_step() {
        let mut motor = Motor::default();
        for (tick, direction) in [(100, 1), (200, 1), (300, -1), (400, -1), (500, -1), (100_500, -1)] {
            motor.step(tick, direction);
        }
        let places: Vec<f64> = [100, 200, 250, 300, 400, 500].map(|tick| motor.at(tick, 1000, 100)).to_vec();
        assert_eq!(places, [0.5, 1.5, 1.5, 1.5, 0.5, -0.5]);
        assert_eq!(motor.at(50_000, 1000, 100), -1.0);
        assert_eq!(motor.at(100_500, 1000, 100), -1.5);
        assert_eq!(motor.at(200_000, 1000, 100), -2.0);
    }
}
