//! Position, speed and acceleration at an instant.

use std::ops::{Add, Sub};

/// Motion of a coordinate at an instant; at constant acceleration it is a parabola in time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Position, mm.
    pub position_mm: f64,
    /// Speed, mm/s.
    pub speed_mm_per_s: f64,
    /// Acceleration, mm/s^2.
    pub acceleration_mm_per_s2: f64,
}

impl Motion {
    /// Creates a motion at rest at a position.
    pub const fn standing(position_mm: f64) -> Self {
        Self { position_mm, speed_mm_per_s: 0.0, acceleration_mm_per_s2: 0.0 }
    }

    /// Returns the motion after a time at constant acceleration; before, if the time is negative.
    pub fn after(self, time_s: f64) -> Self {
        let speed = self.speed_mm_per_s + self.acceleration_mm_per_s2 * time_s;
        Self {
            position_mm: self.position_mm + 0.5 * (self.speed_mm_per_s + speed) * time_s,
            speed_mm_per_s: speed,
            ..self
        }
    }

    /// Returns true if speed and acceleration are 0, to within rounding.
    pub fn is_standing(self) -> bool {
        self.speed_mm_per_s.abs() < 1e-9 && self.acceleration_mm_per_s2.abs() < 1e-6
    }

    /// Adds `factor` times `other`.
    pub fn plus(self, factor: f64, other: Self) -> Self {
        Self {
            position_mm: self.position_mm + factor * other.position_mm,
            speed_mm_per_s: self.speed_mm_per_s + factor * other.speed_mm_per_s,
            acceleration_mm_per_s2: self.acceleration_mm_per_s2 + factor * other.acceleration_mm_per_s2,
        }
    }
}

impl Add for Motion {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        self.plus(1.0, other)
    }
}

impl Sub for Motion {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self.plus(-1.0, other)
    }
}
