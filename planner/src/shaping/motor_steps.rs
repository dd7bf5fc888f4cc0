//! Times of a motor's steps while its position follows a polynomial.

use super::fixed;
use crate::cubic::cube_root_above;
use crate::piece::above_zero;
use crate::square_root::square_root_f32;
use crate::u64_to_f32::of_i64;

/// Newton's steps for a piece with jerk. From a guess that is not below the root, each squares
/// the relative error.
const NEWTON_STEPS: usize = 4;

/// Later than any window ends.
pub(super) const NEVER: u32 = u32::MAX;

/// A motor's motion over a window of time in which it does not turn and its speed only
/// grows or only falls.
#[derive(Clone, Copy, Debug)]
pub(super) struct WindowMotion {
    /// Position at the start and the end, 2^-32 step.
    pub ends: [i64; 2],
    /// Acceleration (steps/tick^2) and jerk at the start. The speed follows from the ends: added up
    /// from axes' and impulses' speeds, that of a slow motor beside a fast one would be lost.
    pub acceleration: f32,
    pub jerk: f32,
    /// Duration, ticks.
    pub ticks: f32,
}

/// A motor: its position, and its steps in the present window.
///
/// It steps when the position passes the middle between two steps. The times count from the end of
/// the window that is the slower one: there 20 ticks are the least part of a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotorSteps {
    /// Position after all steps of the window.
    pub steps: i64,
    /// Steps left in the window, and whether they go backwards.
    left: u32,
    pub is_backwards: bool,
    /// Time of the next step, ticks from the window's start; [`NEVER`] without one.
    pub due: u32,
    /// The slow end: the speed there, and acceleration and jerk away from it.
    speed: f32,
    acceleration: f32,
    jerk: f32,
    /// The slow end is the window's end.
    from_end: bool,
    /// Position of the step that is nearest to the slow end, steps from that end.
    nearest: f32,
    /// Steps by which the next one is farther from the slow end than the nearest one.
    index: u32,
    /// Duration of the window, ticks.
    ticks: f32,
}

impl MotorSteps {
    /// A motor that rests at this position.
    pub const fn standing(steps: i64) -> Self {
        Self {
            steps,
            left: 0,
            is_backwards: false,
            due: NEVER,
            speed: 0.0,
            acceleration: 0.0,
            jerk: 0.0,
            from_end: false,
            nearest: 0.0,
            index: 0,
            ticks: 0.0,
        }
    }

    /// Begins a window.
    // Compiled once, and not for each of the four motors.
    #[inline(never)]
    pub fn begin(&mut self, motion: &WindowMotion) {
        let WindowMotion { ends: [start, end], acceleration, jerk, ticks } = *motion;
        // Relative to the motor's position.
        let here = fixed::of_steps(self.steps);
        let (start, end) = (start.wrapping_sub(here), end.wrapping_sub(here));
        let backwards = end < 0;
        // The motion mirrored so that it goes forwards.
        let (start, end, sign) =
            if backwards { (start.wrapping_neg(), end.wrapping_neg(), -1.0) } else { (start, end, 1.0) };
        // Middles up to the end. One on which the motion rests belongs to the upper step, else the
        // motor went to and fro.
        let reach = fixed::HALF_STEP.wrapping_sub(i64::from(backwards));
        let count = (end.wrapping_add(reach) >> fixed::STEP_BITS) as u32;
        self.left = count;
        if count == 0 {
            self.due = NEVER;
            return;
        }
        let made = i64::from(count);
        self.steps = self.steps.wrapping_add(if backwards { made.wrapping_neg() } else { made });
        let (acceleration, jerk) = (acceleration * sign, jerk * sign);
        let mean = steps(end.wrapping_sub(start)) / ticks;
        let speed = mean - ticks * (0.5 * acceleration + ticks * jerk * (1.0 / 6.0));
        let end_speed = above_zero(speed + ticks * (acceleration + 0.5 * ticks * jerk));
        let speed = above_zero(speed);
        let last = count.wrapping_sub(1);
        self.is_backwards = backwards;
        self.ticks = ticks;
        self.jerk = jerk;
        self.from_end = end_speed < speed;
        if self.from_end {
            self.speed = end_speed;
            self.acceleration = -(acceleration + jerk * ticks);
            let nearest = fixed::of_steps(i64::from(last)).wrapping_add(fixed::HALF_STEP);
            self.nearest = steps(end.wrapping_sub(nearest));
            self.index = last;
        } else {
            self.speed = speed;
            self.acceleration = acceleration;
            self.nearest = steps(fixed::HALF_STEP.wrapping_sub(start));
            self.index = 0;
        }
        self.due = 0;
        self.solve();
    }

    /// Takes the next step.
    #[inline]
    pub fn take(&mut self) {
        self.left = self.left.wrapping_sub(1);
        if self.left == 0 {
            self.due = NEVER;
            return;
        }
        self.index = if self.from_end { self.index.wrapping_sub(1) } else { self.index.wrapping_add(1) };
        self.solve();
    }

    /// Computes the time of the step of this index; never before that of the previous one.
    #[inline]
    fn solve(&mut self) {
        let distance = above_zero(self.nearest + self.index as f32);
        let from_slow_end = self.ticks_over(distance);
        let ticks = if self.from_end { self.ticks - from_slow_end } else { from_slow_end };
        let held = if ticks < self.ticks { ticks } else { self.ticks };
        // Casts saturate: what is before the window is due at its start.
        self.due = self.due.max((held + 0.5) as u32);
    }

    /// Ticks from the slow end over a distance.
    #[inline]
    fn ticks_over(&self, distance: f32) -> f32 {
        let Self { speed, acceleration, jerk, .. } = *self;
        if distance <= 0.0 {
            return 0.0;
        }
        let root = square_root_f32(above_zero(speed * speed + 2.0 * acceleration * distance));
        let quadratic = 2.0 * distance / (speed + root);
        if jerk == 0.0 { quadratic } else { self.with_jerk(distance, quadratic) }
    }

    /// Time with jerk, from the time that it would take without.
    #[inline(never)]
    fn with_jerk(&self, distance: f32, quadratic: f32) -> f32 {
        let Self { speed, acceleration, jerk, ticks, .. } = *self;
        let mut time = quadratic;
        if jerk > 0.0 {
            let cubic = cube_root_above(6.0 * distance / jerk);
            // The quadratic is infinite without speed and acceleration.
            if time > cubic {
                time = cubic;
            }
        }
        if time > ticks {
            time = ticks;
        }
        for _ in 0..NEWTON_STEPS {
            let bend = acceleration + 0.5 * jerk * time;
            let slope = speed + bend * time;
            if slope <= 0.0 {
                break;
            }
            let position = time * (speed + 0.5 * time * (acceleration + jerk * time * (1.0 / 3.0)));
            time = above_zero(time - (position - distance) / slope);
        }
        time
    }
}

/// The nearest number of steps.
#[inline]
fn steps(position: i64) -> f32 {
    const STEPS: f32 = 1.0 / (1_u64 << fixed::STEP_BITS) as f32;
    of_i64(position) * STEPS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motor_that_rests_in_the_middle_between_two_steps_stands() {
        for middle in [fixed::HALF_STEP, -fixed::HALF_STEP, 7 * fixed::HALF_STEP] {
            for from in [middle - 2 * fixed::HALF_STEP, middle + 2 * fixed::HALF_STEP] {
                let mut motor = MotorSteps::standing((from + fixed::HALF_STEP) >> fixed::STEP_BITS);
                let mut steps = 0;
                for ends in [[from, middle], [middle, middle], [middle, middle]] {
                    motor.begin(&WindowMotion { ends, acceleration: 0.0, jerk: 0.0, ticks: 100.0 });
                    while motor.due != NEVER {
                        motor.take();
                        steps += 1;
                    }
                }
                assert!(steps <= 1, "from {from} to {middle}: {steps} steps");
            }
        }
    }
}
