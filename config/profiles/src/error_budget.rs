//! Accelerations that follow from the error that is allowed, in place of a guess.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_planner::{AxisShaper, Limits, MotionChoice, smooth_ticks};

use crate::axes::AXES;
use crate::response::{FrameMode, Response, impulses};

const BUDGET: Range = range(0.001, 1.0, "mm");
const FREQUENCY: Range = range(AxisShaper::FREQUENCY_HZ[0], AxisShaper::FREQUENCY_HZ[1], "Hz");
const DAMPING: Range = range(0.0, 0.6, "");

/// Maximum uncertainty of a frame's frequency, as a share of it: a frame that is known
/// worse gives no limit.
const MAX_UNCERTAINTY: f64 = 0.5;

/// The least acceleration that a budget may lead to, mm/s^2. A machine that accelerates less has
/// better uses for a smaller error.
const MIN_ACCELERATION_MM_PER_S2: f64 = 100.0;

/// The part of the largest error that 99 % of the time stays below, on the examples of the book's
/// page with filters of every length and frequencies right and wrong. The nozzle is farther off
/// for moments only.
const PART_OF_LARGEST: f64 = 0.75;

/// A profile's error budget, and the frame that causes the errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBudget {
    /// Maximum distance of the nozzle from its path in 99 % of the printing time, mm.
    pub budget_mm: Option<f64>,
    /// The frame along X and Y.
    pub frame: [Option<FrameMode>; 2],
}

/// The budget and the frame. They bind no prepared job: the accelerations that follow do.
pub(crate) fn read(keys: &Section<'_>) -> ErrorBudget {
    let keys = keys.apart();
    let budget_mm = keys.number("error_budget_mm", BUDGET).optional(
        "accelerations as set above",
        "maximum distance of the nozzle from its path in 99 % of the printing time: [accelerations of X and Y are \
         lowered](error-budget.md) until frame and input_shaper keep it",
    );
    let frame = keys.section_of_defaults(
        "frame",
        "ringing that [`calibrate shaper`](calibration.md) measures, for `error_budget_mm`",
    );
    let [x, y, _] = AXES;
    let frame = [x, y].map(|axis| frame.optional_section(axis, "not known", "").map(|axis| mode(&axis)));
    ErrorBudget { budget_mm, frame }
}

fn mode(keys: &Section<'_>) -> FrameMode {
    let frequency_hz = keys.number("frequency_hz", FREQUENCY).required("ringing frequency of the axis");
    let most_hz = MAX_UNCERTAINTY * frequency_hz;
    let uncertainty =
        range(0.0, FREQUENCY.high * MAX_UNCERTAINTY, "Hz").at_most(most_hz, "at most half of frequency_hz");
    let frequency_uncertainty_hz = keys
        .number("frequency_uncertainty_hz", uncertainty)
        .required("maximum deviation from `frequency_hz`, whatever is printed");
    let damping = keys.number("damping", DAMPING).or(AxisShaper::NONE.damping, "damping ratio, known to ±50 %");
    FrameMode { frequency_hz, frequency_uncertainty_hz, damping }
}

impl ErrorBudget {
    /// Lowers the accelerations of X and Y until they keep the budget.
    pub(crate) fn apply(
        &self,
        keys: &Section<'_>,
        motion: &MotionChoice,
        steps_per_mm: &[f64; 4],
        limits: &mut Limits,
    ) {
        let Some(budget_mm) = self.budget_mm else { return };
        let [Some(x), Some(y)] = &self.frame else {
            let expected = "frame.x and frame.y in the profile, with the frequency_hz and frequency_uncertainty_hz \
                            that `ferrostep calibrate shaper` prints";
            return keys.refuse("error_budget_mm", expected);
        };
        let mut too_small: Option<(&str, f64)> = None;
        for (axis, mode) in [x, y].into_iter().enumerate() {
            // A filter that cannot be made is refused by its own keys.
            let Ok(kernel) = motion.shapers[axis].kernel() else { continue };
            let smooth_ticks = smooth_ticks(motion.smooth_time_s).unwrap_or(0);
            let axis_error = AxisError {
                response: mode.worst(&impulses(&kernel, smooth_ticks)),
                junction_deviation_mm: limits.junction_deviation_mm,
                max_jump_mm_per_s: limits.instantaneous_corner_velocity_mm_per_s[axis],
                step_mm: 1.0 / steps_per_mm[axis],
            };
            let least_mm = axis_error.of_acceleration(MIN_ACCELERATION_MM_PER_S2);
            if budget_mm < least_mm {
                if too_small.is_none_or(|(_, other_mm)| other_mm < least_mm) {
                    too_small = Some((AXES[axis], least_mm));
                }
                continue;
            }
            let acceleration = axis_error.acceleration_of(budget_mm).floor();
            let limit = &mut limits.max_acceleration_mm_per_s2[axis];
            *limit = limit.min(acceleration);
        }
        if let Some((axis, least_mm)) = too_small {
            let least_mm = (least_mm * 1e4).ceil() * 1e-4;
            keys.refuse(
                "error_budget_mm",
                format!(
                    "at least {least_mm:.4} mm, with which {axis} accelerates at {MIN_ACCELERATION_MM_PER_S2} mm/s^2; for less, a \
                     smaller frame.{axis}.frequency_uncertainty_hz, a shorter input_shaper.{axis} or a smaller junction_deviation_mm"
                ),
            );
        }
        keys.bind("max_acceleration_mm_per_s2", &limits.max_acceleration_mm_per_s2);
    }
}

/// Quantities that determine the error of an axis.
#[derive(Clone, Copy, Debug)]
struct AxisError {
    response: Response,
    junction_deviation_mm: f64,
    /// The most by which the speed may jump at a corner, mm/s; infinite where only
    /// the arc limits it.
    max_jump_mm_per_s: f64,
    step_mm: f64,
}

impl AxisError {
    /// The error, mm, at an acceleration, mm/s^2: that of the acceleration's jump and of the
    /// largest jump of the speed at one time, and half a step.
    ///
    /// The speed jumps by 2 v sin(t/2) at a corner that turns by t, which is passed at v^2 = a
    /// delta c / (1 - c) with c = cos(t/2). That is a delta 4 c (1 + c) squared, at most 8 a delta.
    fn of_acceleration(&self, acceleration: f64) -> f64 {
        let jump = (8.0 * acceleration * self.junction_deviation_mm).sqrt().min(self.max_jump_mm_per_s);
        let swing_mm = self.response.of_acceleration_s2 * acceleration + self.response.of_speed_s * jump;
        PART_OF_LARGEST * swing_mm + 0.5 * self.step_mm
    }

    /// The acceleration, mm/s^2, with this error, mm, which is at least half a step.
    fn acceleration_of(&self, error_mm: f64) -> f64 {
        let Response { of_acceleration_s2, of_speed_s } = self.response;
        let swing_mm = (error_mm - 0.5 * self.step_mm).max(0.0) / PART_OF_LARGEST;
        // With jumps that the acceleration limits: a quadratic equation in its root.
        let linear = of_speed_s * (8.0 * self.junction_deviation_mm).sqrt();
        let root = 2.0 * swing_mm / (linear + (linear * linear + 4.0 * of_acceleration_s2 * swing_mm).sqrt());
        // With jumps that have their own limit.
        let limited = (swing_mm - of_speed_s * self.max_jump_mm_per_s) / of_acceleration_s2;
        (root * root).max(limited)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_acceleration_has_the_error_that_was_asked_for(
            frequency_hz in 20.0..120.0f64,
            part in 0.0..0.3f64,
            junction_deviation_mm in prop_oneof![0.0001..0.2f64],
            max_jump_mm_per_s in prop_oneof![Just(f64::INFINITY), 0.1..40.0f64],
            steps_per_mm in 50.0..400.0f64,
            error_mm in 0.011..0.3f64,
        ) {
            let mode = FrameMode { frequency_hz, frequency_uncertainty_hz: part * frequency_hz, damping: 0.06 };
            let shaper = AxisShaper { kind: ferrostep_planner::ShaperKind::Zv, frequency_hz, damping: 0.1 };
            let axis = AxisError {
                response: mode.worst(shaper.kernel().unwrap().impulses()),
                junction_deviation_mm,
                max_jump_mm_per_s,
                step_mm: 1.0 / steps_per_mm,
            };
            let acceleration = axis.acceleration_of(error_mm);
            prop_assert!((axis.of_acceleration(acceleration) / error_mm - 1.0).abs() < 1e-6, "{acceleration}");
            prop_assert!(axis.acceleration_of(1.1 * error_mm) > acceleration);
        }
    }
}
