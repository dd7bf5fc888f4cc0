//! Input shaping: every axis follows the plan through a filter of its own, which leaves the frame at rest.
//!
//! A shaper ([`AxisShaper`]) gives a [`Kernel`]: weights and delays. The shaped position of an axis is the weighted sum of its
//! planned positions at those delays (Singer and Seering 1990).
//!
//! The extruder's filter spreads the flow as the shapers and the frame together spread the path, so that the filament comes where
//! the nozzle is; its advance ([`PressureAdvance`]) is the mean between two delays.

mod even_spacing;
mod fixed;
mod kernel;
mod motor_steps;
mod path_pieces;
mod plan;
mod plan_ring;
mod shapers;
mod stepper;
mod taps;

pub use even_spacing::EvenSpacing;
pub use kernel::{Impulse, Kernel, MAX_IMPULSES};
pub use shapers::{AxisShaper, ShaperError, ShaperKind};

pub(crate) use plan_ring::MOST_IN_FILTER;
pub(crate) use stepper::{ShapedStepper, Standing};

use crate::limits::ExtruderAdvance;
use crate::pressure_advance::PressureAdvance;
use crate::square_root::square_root_f32;
use crate::time_units::TICKS_PER_SECOND;

/// The longest filter, ticks: 100 ms. What the machine executes is later than planned by no more than this.
pub const MAX_LENGTH_TICKS: u32 = TICKS_PER_SECOND / 10;

/// The least time over which an advance is averaged unless another is given, s: at a common K the extruder can follow it.
const LEAST_SMOOTH_TIME_S: f64 = 0.008;

/// An average over B has a variance of B^2 / 12. The least filament is misplaced at corners where B is somewhat shorter than the one
/// with the path's variance.
const PART_OF_SPREAD: f64 = 0.9;

/// The filters of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaping {
    /// That of X.
    pub x: Kernel,
    /// That of Y.
    pub y: Kernel,
    /// By how much the filters and the frame together spread the path of the nozzle, squared ticks: the mean of X's variance and Y's,
    /// at least 0. The extruder's filter has it too.
    pub path_variance: f64,
    /// Over how many ticks the extruder's advance is averaged; 0: it has none.
    pub advance_ticks: u32,
}

impl Shaping {
    /// No filters: every motor follows the plan itself.
    pub const NONE: Self = Self { x: Kernel::IDENTITY, y: Kernel::IDENTITY, path_variance: 0.0, advance_ticks: 0 };

    /// The filters of these shapers of X and Y, and of this advance.
    ///
    /// # Errors
    /// The first shaper that cannot be made.
    pub fn new(shapers: &[AxisShaper; 2], advance: &PressureAdvance) -> Result<Self, ShaperError> {
        let [x, y] = shapers;
        let (x_kernel, y_kernel) = (x.kernel()?, y.kernel()?);
        let variance = 0.5 * (x.path_variance(&x_kernel) + y.path_variance(&y_kernel));
        let path_variance = if variance > 0.0 { variance } else { 0.0 };
        let filters = Self { x: x_kernel, y: y_kernel, path_variance, advance_ticks: 0 };
        let advance_ticks = if advance.is_some() { filters.average_ticks(advance.smooth_time_s) } else { 0 };
        Ok(Self { advance_ticks, ..filters })
    }

    /// Over how many ticks an advance is averaged.
    #[cold]
    fn average_ticks(&self, smooth_time_s: Option<f64>) -> u32 {
        let ticks_per_second = f64::from(TICKS_PER_SECOND);
        let ticks = smooth_time_s.map(|time_s| time_s * ticks_per_second).unwrap_or_else(|| {
            let spread = PART_OF_SPREAD * f64::from(square_root_f32((12.0 * self.path_variance) as f32));
            let least = LEAST_SMOOTH_TIME_S * ticks_per_second;
            if spread > least { spread } else { least }
        });
        // Even, so that both halves are whole ticks.
        2 * (0.5 * ticks + 0.5) as u32
    }

    /// What an advance takes of the extruder; `None`: nothing.
    pub(crate) fn extruder_advance(&self, advance: &PressureAdvance) -> Option<ExtruderAdvance> {
        let seconds = advance.largest_seconds() as f32;
        let smooth_time_s = self.advance_ticks as f32 / TICKS_PER_SECOND as f32;
        (seconds > 0.0 && smooth_time_s > 0.0).then_some(ExtruderAdvance { seconds, smooth_time_s })
    }

    /// Whether anything is filtered.
    pub fn is_active(&self) -> bool {
        *self != Self::NONE
    }
}
