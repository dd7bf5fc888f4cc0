//! Text of the reason why an extruder refuses a pressure advance.

use core::fmt;

use ferrostep_gcode::Real;
use ferrostep_planner::{PressureAdvance, PressureAdvanceError};

/// Reason to refuse an advance: the number that is out of range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdvanceRefusal {
    error: PressureAdvanceError,
    value: f64,
}

impl AdvanceRefusal {
    pub(crate) fn new(error: PressureAdvanceError, advance: &PressureAdvance) -> Self {
        let PressureAdvance { seconds, above, smooth_time_s } = *advance;
        let value = match error {
            PressureAdvanceError::Seconds if (0.0..=PressureAdvance::MAX_SECONDS).contains(&seconds) => {
                above.map_or(seconds, |above| above.seconds)
            }
            PressureAdvanceError::Seconds => seconds,
            PressureAdvanceError::Speed => above.map_or(0.0, |above| above.filament_mm_per_s),
            PressureAdvanceError::SmoothTime => smooth_time_s.unwrap_or(0.0),
        };
        Self { error, value }
    }
}

impl fmt::Display for AdvanceRefusal {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([least, most], unit, words) = match self.error {
            PressureAdvanceError::Seconds => ([0.0, PressureAdvance::MAX_SECONDS], "s", "M572 S or L, ADVANCE"),
            PressureAdvanceError::Speed => (PressureAdvance::FILAMENT_MM_PER_S, "mm/s", "M572 T"),
            PressureAdvanceError::SmoothTime => (PressureAdvance::SMOOTH_TIME_S, "s", "M572 W, SMOOTH_TIME"),
        };
        let [value, least, most] = [self.value, least, most].map(|number| Real::short(number, 6));
        write!(out, "pressure advance: {value} {unit} is out of range, expected {least} to {most} {unit} ({words})")
    }
}
