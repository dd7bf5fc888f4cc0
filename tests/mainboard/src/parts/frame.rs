//! The frame between motors and nozzle: a mass on a spring along each of X and Y.
//!
//! `x'' + 2 z w x' + w^2 (x - u) = 0` with the motors' position `u`, which stands still from one
//! step to the next, so that the solution is exact at any time (a textbook's damped oscillator). At
//! rest the mass is at `u`.
//!
//! Left out: more modes than one, modes that couple X and Y, Z.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

/// A mode along one axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Mode {
    omega: f64,
    damping: f64,
    command_mm: f64,
    away_mm: f64,
    speed_mm_per_s: f64,
}

impl Mode {
    /// A mode at rest at `command_mm`: undamped frequency, and damping ratio below 1.
    pub fn new(frequency_hz: f64, damping: f64, command_mm: f64) -> Self {
        Self { omega: TAU * frequency_hz, damping, command_mm, away_mm: 0.0, speed_mm_per_s: 0.0 }
    }

    /// Advances time, s.
    pub fn advance(&mut self, time_s: f64) {
        let decay = self.damping * self.omega;
        let damped = self.omega * (1.0 - self.damping * self.damping).sqrt();
        let (sine, cosine) = (damped * time_s).sin_cos();
        let left = (-decay * time_s).exp();
        let (away, speed) = (self.away_mm, self.speed_mm_per_s);
        self.away_mm = left * (away * cosine + (speed + decay * away) / damped * sine);
        self.speed_mm_per_s =
            left * (speed * cosine - (decay * speed + self.omega * self.omega * away) / damped * sine);
    }

    /// The motors move to this place at once.
    pub fn command(&mut self, command_mm: f64) {
        self.away_mm += self.command_mm - command_mm;
        self.command_mm = command_mm;
    }

    /// Acceleration of the mass, mm/s^2.
    pub fn acceleration_mm_per_s2(&self) -> f64 {
        -self.omega * (self.omega * self.away_mm + 2.0 * self.damping * self.speed_mm_per_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a swing after a step the mass is as far beyond it as the damping leaves; the frequency
    /// is the damped one.
    #[test]
    fn a_step_rings_at_the_damped_frequency_and_dies_away() {
        let damping: f64 = 0.05;
        let mut mode = Mode::new(40.0, damping, 100.0);
        mode.command(100.01);
        // w^2 times 10 um.
        let omega = TAU * 40.0;
        assert!((mode.acceleration_mm_per_s2() - omega * omega * 0.01).abs() < 1e-9);
        let half_s = 0.5 / (40.0 * (1.0 - damping * damping).sqrt());
        let left = (-damping * omega * half_s).exp();
        mode.advance(half_s);
        assert!((mode.away_mm - 0.01 * left).abs() < 1e-12 && mode.speed_mm_per_s.abs() < 1e-9, "{mode:?}");
        // Many short times are as one long one.
        let mut other = mode;
        (0..1000).for_each(|_| other.advance(1e-5));
        mode.advance(0.01);
        assert!((mode.away_mm - other.away_mm).abs() < 1e-12);
        mode.advance(5.0);
        assert!(mode.acceleration_mm_per_s2().abs() < 1e-9);
    }

    /// The equation of motion, by differences.
    #[test]
    fn the_equation_of_motion_holds() {
        let mut mode = Mode::new(50.0, 0.1, 0.0);
        mode.command(0.1);
        mode.advance(0.0123);
        let (mut before, mut after) = (mode, mode);
        let dt = 1e-6;
        before.advance(-dt);
        after.advance(dt);
        let by_differences = (after.speed_mm_per_s - before.speed_mm_per_s) / (2.0 * dt);
        assert!((by_differences - mode.acceleration_mm_per_s2()).abs() < 1e-3 * by_differences.abs());
        let speed = (after.away_mm - before.away_mm) / (2.0 * dt);
        assert!((speed - mode.speed_mm_per_s).abs() < 1e-3 * speed.abs());
    }
}
