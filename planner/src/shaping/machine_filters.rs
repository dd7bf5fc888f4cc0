//! The filters of a machine: the kernels of X and Y, the extruder's variance, and the averages.

use super::kernel::Kernel;
use super::shapers::{AxisShaper, ShaperError};
use crate::limits::ExtruderAdvance;
use crate::pressure_advance::PressureAdvance;
use crate::square_root::square_root_f32;
use crate::time_units::TICKS_PER_SECOND;

/// The least time over which an advance is averaged unless another is given, s: at a common K the
/// extruder can follow it.
const LEAST_SMOOTH_TIME_S: f64 = 0.008;

/// An average over B has a variance of B^2 / 12. The least filament is misplaced at corners where B
/// is somewhat shorter than the one with the path's variance.
const PART_OF_SPREAD: f64 = 0.9;

/// Times for the moving average of all axes, s.
pub const SMOOTH_TIME_S: [f64; 2] = [0.001, 0.05];

/// The filters of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaping {
    /// Kernel of X.
    pub x: Kernel,
    /// Kernel of Y.
    pub y: Kernel,
    /// Variance by which the shapers and the frame together spread the path of the nozzle, squared
    /// ticks: the mean of X's and Y's, at least 0. The extruder's impulses have the same variance.
    pub extruder_variance: f64,
    /// Ticks over which X, Y, Z and the extruder are averaged after that, an even number;
    /// 0: no averaging.
    pub smooth_ticks: u32,
    /// Ticks over which the extruder's advance is averaged; 0: no advance.
    pub advance_ticks: u32,
}

impl Shaping {
    /// No filters: every motor follows the plan itself.
    pub const NONE: Self =
        Self { x: Kernel::IDENTITY, y: Kernel::IDENTITY, extruder_variance: 0.0, smooth_ticks: 0, advance_ticks: 0 };

    /// The filters of these shapers of X and Y, of a moving average over a time within
    /// [`SMOOTH_TIME_S`], and of this advance.
    ///
    /// # Errors
    /// The first that cannot be made.
    pub fn new(
        shapers: &[AxisShaper; 2],
        smooth_time_s: Option<f64>,
        advance: &PressureAdvance,
    ) -> Result<Self, ShaperError> {
        let [x, y] = shapers;
        let smooth_ticks = smooth_ticks(smooth_time_s)?;
        let (x_kernel, y_kernel) = (x.kernel_beside(smooth_ticks)?, y.kernel_beside(smooth_ticks)?);
        let variance = 0.5 * (x.path_variance(&x_kernel) + y.path_variance(&y_kernel));
        let extruder_variance = if variance > 0.0 { variance } else { 0.0 };
        let filters = Self { x: x_kernel, y: y_kernel, extruder_variance, smooth_ticks, advance_ticks: 0 };
        let advance_ticks = if advance.is_some() { filters.average_ticks(advance.smooth_time_s) } else { 0 };
        Ok(Self { advance_ticks, ..filters })
    }

    /// The variance of the moving average, squared ticks.
    fn smooth_variance(&self) -> f64 {
        f64::from(self.smooth_ticks) * f64::from(self.smooth_ticks) * (1.0 / 12.0)
    }

    /// Ticks over which an advance is averaged.
    #[cold]
    fn average_ticks(&self, smooth_time_s: Option<f64>) -> u32 {
        let ticks_per_second = f64::from(TICKS_PER_SECOND);
        let ticks = smooth_time_s.map(|time_s| time_s * ticks_per_second).unwrap_or_else(|| {
            let spread = PART_OF_SPREAD
                * f64::from(square_root_f32((12.0 * (self.extruder_variance + self.smooth_variance())) as f32));
            let least = LEAST_SMOOTH_TIME_S * ticks_per_second;
            if spread > least { spread } else { least }
        });
        even_ticks(ticks)
    }

    /// Share of the extruder taken by an advance; `None`: nothing.
    pub(crate) fn extruder_advance(&self, advance: &PressureAdvance) -> Option<ExtruderAdvance> {
        let seconds = advance.largest_seconds() as f32;
        let smooth_time_s = self.advance_ticks as f32 / TICKS_PER_SECOND as f32;
        (seconds > 0.0 && smooth_time_s > 0.0).then_some(ExtruderAdvance { seconds, smooth_time_s })
    }

    /// True if anything is filtered.
    pub fn is_active(&self) -> bool {
        *self != Self::NONE
    }
}

/// The ticks of a moving average over this time.
///
/// # Errors
/// [`ShaperError::SmoothTime`].
#[cold]
pub fn smooth_ticks(smooth_time_s: Option<f64>) -> Result<u32, ShaperError> {
    let [least, most] = SMOOTH_TIME_S;
    match smooth_time_s {
        None => Ok(0),
        Some(time_s) if time_s >= least && time_s <= most => Ok(even_ticks(time_s * f64::from(TICKS_PER_SECOND))),
        // NaN is in no range.
        Some(_) => Err(ShaperError::SmoothTime),
    }
}

/// Nearest even number of ticks, so that half of it is whole.
fn even_ticks(ticks: f64) -> u32 {
    2 * (0.5 * ticks + 0.5) as u32
}
