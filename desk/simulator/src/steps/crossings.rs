//! Interpolates a motor's position between its steps.

use crate::measures::SAMPLE_S;
use std::collections::VecDeque;

/// Time without a step after which a motor counts as at rest, s.
const REST_S: f64 = 0.05;

/// Maximum time to settle from a crossing to the rest position, and to leave it again, s.
const SETTLE_S: f64 = 0.005;

/// Positions of a motor at the samples, in steps, interpolated linearly between crossings. A step
/// occurs where the position passes the middle between two whole steps.
#[derive(Debug, Default)]
pub(super) struct Crossings {
    position: i64,
    /// Time of the last step, s; `None` once the motor is at rest.
    last_step_s: Option<f64>,
    /// End of the interpolated line: time, s, and position, steps.
    drawn_s: f64,
    drawn: f64,
    /// Number of samples interpolated so far.
    count: u64,
    samples: VecDeque<f64>,
}

impl Crossings {
    fn draw_to(&mut self, time_s: f64, position: f64) {
        loop {
            let sample_s = (self.count + 1) as f64 * SAMPLE_S;
            if sample_s > time_s {
                break;
            }
            let part = if time_s > self.drawn_s { (sample_s - self.drawn_s) / (time_s - self.drawn_s) } else { 1.0 };
            self.samples.push_back(self.drawn + part * (position - self.drawn));
            self.count += 1;
        }
        self.drawn_s = self.drawn_s.max(time_s);
        self.drawn = position;
    }

    /// Steps the motor by 1 or -1.
    pub(super) fn step(&mut self, time_s: f64, step: i64) {
        let crossing = self.position as f64 + 0.5 * step as f64;
        match self.last_step_s {
            Some(last_s) if time_s - last_s <= REST_S => {}
            last_s => {
                let last_s = last_s.unwrap_or(self.drawn_s);
                let settle_s = (0.5 * (time_s - last_s)).clamp(0.0, SETTLE_S);
                let rest = self.position as f64;
                self.draw_to((last_s + settle_s).max(self.drawn_s), rest);
                self.draw_to((time_s - settle_s).max(self.drawn_s), rest);
            }
        }
        self.draw_to(time_s, crossing);
        self.position += step;
        self.last_step_s = Some(time_s);
    }

    /// Advances to a time without a step.
    pub(super) fn idle(&mut self, time_s: f64) {
        let rest = self.position as f64;
        if let Some(last_s) = self.last_step_s {
            if time_s - last_s <= REST_S {
                return;
            }
            self.last_step_s = None;
            self.draw_to(last_s + SETTLE_S, rest);
        }
        // The motor may start to move again just before its next step.
        if time_s - SETTLE_S > self.drawn_s {
            self.draw_to(time_s - SETTLE_S, rest);
        }
    }

    /// Changes the origin of the position by `by` steps; nothing moves.
    pub(super) fn redefine(&mut self, time_s: f64, by: i64) {
        self.last_step_s = None;
        let rest = self.position as f64;
        self.draw_to(time_s, rest);
        self.position += by;
        self.drawn += by as f64;
    }

    pub(super) fn has_sample(&self) -> bool {
        !self.samples.is_empty()
    }

    pub(super) fn take_sample(&mut self) -> f64 {
        self.samples.pop_front().unwrap_or(self.drawn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(mut crossings: Crossings) -> Vec<f64> {
        std::iter::from_fn(|| crossings.has_sample().then(|| crossings.take_sample())).collect()
    }

    #[test]
    fn even_steps_are_a_straight_line() {
        let mut crossings = Crossings::default();
        // 1000 steps/s from 1 s on: the first crossing, at 0.5 steps, is at 1 s.
        (0..500).for_each(|step| crossings.step(1.0 + f64::from(step) * 0.001, 1));
        crossings.idle(3.0);
        let samples = samples(crossings);
        for (index, sample) in samples.iter().enumerate() {
            let time_s = (index + 1) as f64 * SAMPLE_S;
            if (1.0..=1.499).contains(&time_s) {
                assert!((sample - 0.5 - (time_s - 1.0) * 1000.0).abs() < 1e-6, "{time_s}: {sample}");
            } else if !(0.995..1.505).contains(&time_s) {
                assert_eq!(*sample, if time_s < 1.2 { 0.0 } else { 500.0 });
            }
        }
        assert!((samples.len() as f64 * SAMPLE_S - 2.995).abs() < 0.001);
    }

    #[test]
    fn a_pause_stands_at_the_whole_step() {
        let mut crossings = Crossings::default();
        crossings.step(0.1, 1);
        crossings.idle(0.5);
        crossings.step(0.6, -1);
        crossings.idle(1.0);
        let samples = samples(crossings);
        let at = |time_s: f64| samples[(time_s / SAMPLE_S) as usize - 1];
        assert_eq!((at(0.05), at(0.3), at(0.9)), (0.0, 1.0, 0.0));
        assert!((at(0.1) - 0.5).abs() < 1e-6 && (at(0.6) - 0.5).abs() < 1e-6);
    }
}
