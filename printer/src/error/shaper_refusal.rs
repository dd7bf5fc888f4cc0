//! Text of the reason why a machine refuses a filter.

use core::fmt;

use ferrostep_gcode::Real;
use ferrostep_planner::{AxisShaper, ChoiceError, EvenSpacing, ShaperError, ShaperKind};

use crate::motion::axis_names::AXIS_NAMES;

/// Names of all filters.
pub(crate) struct KnownShapers;

impl fmt::Display for KnownShapers {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, _) in ShaperKind::NAMED {
            out.write_str(name)?;
            out.write_str(", ")?;
        }
        out.write_str(
            "mzv(N,T) with N impulses over T periods, ei2 (2hump_ei) or ei3 (3hump_ei) in M593 P or SHAPER_TYPE",
        )
    }
}

/// Reason why a filter cannot be made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaperRefusal {
    /// Index of the axis, 0 or 1.
    pub(crate) axis: u8,
    /// Reason of the refusal.
    pub(crate) error: ShaperError,
    /// The requested filter.
    pub(crate) shaper: AxisShaper,
}

impl fmt::Display for ShaperRefusal {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axis = AXIS_NAMES.get(usize::from(self.axis)).copied().unwrap_or('?');
        write!(out, "input shaper of {axis}: ")?;
        match self.error {
            ShaperError::Frequency => self.write_frequency(out, axis),
            ShaperError::Damping => self.write_damping(out, axis),
            ShaperError::Spacing => self.write_spacing(out),
            ShaperError::TooLong { lowest_hundredths_hz, is_smooth } => {
                self.write_too_long(out, axis, f64::from(lowest_hundredths_hz) / 100.0, is_smooth)
            }
            // Errors of the machine, independent of the filter.
            ShaperError::Methods | ShaperError::UnequalMotors | ShaperError::SmoothTime | ShaperError::SmoothSCurve => {
                out.write_str(choice_text(ChoiceError::Shaper(self.error)))
            }
        }
    }
}

/// A separate function for each text, so that their arguments are never all on the stack.
impl ShaperRefusal {
    #[inline(never)]
    fn write_frequency(&self, out: &mut fmt::Formatter<'_>, axis: char) -> fmt::Result {
        let [lowest, highest] = AxisShaper::FREQUENCY_HZ.map(|limit| Real::short(limit, 6));
        write!(
            out,
            "{} Hz is out of range, expected {lowest} to {highest} Hz",
            Real::short(self.shaper.frequency_hz, 6)
        )?;
        write!(out, ", or 0 for none (M593 F, SHAPER_FREQ_{axis})")
    }

    #[inline(never)]
    fn write_damping(&self, out: &mut fmt::Formatter<'_>, axis: char) -> fmt::Result {
        let AxisShaper { kind, damping, .. } = self.shaper;
        let [damping, most] = [damping, kind.max_damping()].map(|ratio| Real::short(ratio, 6));
        write!(out, "a damping ratio of {damping} is out of range, expected 0 to {most} for {kind}")?;
        write!(out, " (M593 D or S, DAMPING_RATIO_{axis})")
    }

    #[inline(never)]
    fn write_spacing(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: expected mzv(N,T) with {}", self.shaper.kind, EvenSpacing::RULE)
    }

    #[inline(never)]
    fn write_too_long(&self, out: &mut fmt::Formatter<'_>, axis: char, lowest_hz: f64, is_smooth: bool) -> fmt::Result {
        let with = if is_smooth { " with the profile's input_shaper.smooth_time_s" } else { "" };
        let AxisShaper { kind, frequency_hz, damping } = self.shaper;
        write!(out, "{kind} for {} Hz", Real::short(frequency_hz, 6))?;
        write!(out, " and a damping ratio of {} is longer than 100 ms{with}", Real::short(damping, 6))?;
        write!(out, ", expected at least {} Hz", Real::short(lowest_hz, 6))?;
        write!(out, " (M593 F, SHAPER_FREQ_{axis}) or a shorter kind")
    }
}

/// Reason why a machine with a moving average cannot use S-curves.
pub(crate) const SMOOTH_S_CURVE: &str = "input_shaper.smooth_time_s of the profile needs trapezoids: send M796 A0";

/// Text of the reason why a machine cannot use any filters now.
pub(crate) const fn choice_text(error: ChoiceError) -> &'static str {
    match error {
        ChoiceError::Shaper(ShaperError::UnequalMotors) => {
            "input shapers and pressure advance need equal steps/mm on motors that move an axis together: set those of the profile"
        }
        ChoiceError::Shaper(ShaperError::SmoothSCurve) => SMOOTH_S_CURVE,
        ChoiceError::InMotion => "input shapers and pressure advance change at standstill only: send M400 first",
        ChoiceError::Shaper(
            ShaperError::Methods
            | ShaperError::Frequency
            | ShaperError::Damping
            | ShaperError::Spacing
            | ShaperError::SmoothTime
            | ShaperError::TooLong { .. },
        )
        | ChoiceError::NotContained
        | ChoiceError::Parameter
        | ChoiceError::PressureAdvance(_) => {
            "input shapers and pressure advance need step-bresenham with trapezoid or s-curve: send M796 I0 A0 first"
        }
    }
}
