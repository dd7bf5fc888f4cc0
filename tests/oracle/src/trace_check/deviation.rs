//! Distance of a motor from its time law.

use std::fmt;

/// Deviation of a motor from its position by the time law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Distance from the law, in steps.
    pub steps: f64,
    /// Distance that is allowed there, in steps.
    pub allowed_steps: f64,
    /// The move's source line.
    pub line: u32,
    /// The step event's tick.
    pub tick: u64,
}

impl Deviation {
    /// Distance beyond what is allowed, in steps; negative inside.
    pub fn excess_steps(&self) -> f64 {
        self.steps - self.allowed_steps
    }
}

impl fmt::Display for Deviation {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { steps, allowed_steps, line, tick } = self;
        write!(formatter, "{steps:.3} steps off (allowed {allowed_steps:.3}) at tick {tick} of line {line}")
    }
}
