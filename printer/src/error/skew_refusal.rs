//! Text of the reason why a skew is refused.

use core::fmt;

use ferrostep_gcode::Real;

use crate::motion::skew::Skew;

/// Error: axes must not be that far from a right angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkewRefusal {
    /// The two axes, such as `XY`.
    pub plane: &'static str,
    /// The factor; infinite if the three lengths do not form a parallelogram.
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
            "{plane}: the axes are {percent} % out of square, expected -{most} to {most} %: measure again, or mend the frame"
        )
    }
}
