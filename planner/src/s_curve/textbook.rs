//! A ramp by the textbook, in f64, for tests.

/// The acceleration rises at the jerk, is held at its limit where it gets there, and falls at the
/// jerk. Any unit of length; seconds.
#[derive(Clone, Copy, Debug)]
pub struct Ramp {
    from: f64,
    to: f64,
    /// Half of its duration.
    pub half_time_s: f64,
    jerk_time_s: f64,
    jerk: f64,
}

impl Ramp {
    /// Ramp between two speeds.
    pub fn new(from: f64, to: f64, jerk: f64, acceleration: f64) -> Self {
        let change = (to - from).abs();
        let jerk_time_s = (change / jerk).sqrt().min(acceleration / jerk);
        let held_s = if jerk_time_s > 0.0 { change / (jerk * jerk_time_s) - jerk_time_s } else { 0.0 };
        Self { from, to, half_time_s: jerk_time_s + held_s / 2.0, jerk_time_s, jerk: jerk.copysign(to - from) }
    }

    /// Path it takes.
    pub fn length(&self) -> f64 {
        (self.from + self.to) * self.half_time_s
    }

    /// Path up to a time.
    pub fn length_at(&self, time_s: f64) -> f64 {
        let Self { from, to, half_time_s, jerk_time_s, jerk } = *self;
        let rest_s = 2.0 * half_time_s - time_s;
        if time_s <= jerk_time_s {
            time_s * (from + jerk * time_s * time_s / 6.0)
        } else if rest_s <= jerk_time_s {
            self.length() - rest_s * (to - jerk * rest_s * rest_s / 6.0)
        } else {
            let held_s = time_s - jerk_time_s;
            let early = jerk_time_s * (from + jerk * jerk_time_s * jerk_time_s / 6.0);
            let speed = from + jerk * jerk_time_s * jerk_time_s / 2.0;
            early + held_s * (speed + jerk * jerk_time_s * held_s / 2.0)
        }
    }
}
