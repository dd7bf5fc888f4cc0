//! Why axes are not taken to be that skew, in words.

use core::fmt;

use ferrostep_gcode::Real;

use crate::motion::skew::Skew;

/// Axes may not be that far off their right angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkewRefusal {
    /// Which ones, such as `XY`.
    pub plane: &'static str,
    /// The factor; infinite where three lengths are no parallelogram's.
    pub factor: f32,
}

impl fmt::Display for SkewRefusal {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { plane, factor } = *self;
        if !factor.is_finite() {
            return write!(
                out,
                "{plane}: no parallelogram has these lengths: measure its diagonals AC and BD, and its side AD"
            );
        }
        let [percent, most] = [factor, Skew::MAX_FACTOR].map(|factor| Real::short(f64::from(factor * 100.0), 2));
        write!(
            out,
            "{plane}: the axes are {percent} % off their right angle, expected -{most} to {most} %: measure again, or mend the frame"
        )
    }
}
