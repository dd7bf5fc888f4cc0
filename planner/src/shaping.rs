//! Input shaping: every axis follows the plan through a filter of its own, which leaves the frame at rest.
//!
//! A shaper ([`AxisShaper`]) gives a [`Kernel`]: weights and delays. The shaped position of an axis is the weighted sum of its
//! planned positions at those delays (Singer and Seering 1990).

mod fixed;
mod kernel;
mod motor_steps;
mod path_pieces;
mod plan_ring;
mod shapers;
mod stepper;
mod taps;

pub use kernel::{Impulse, Kernel, MAX_IMPULSES};
pub use shapers::{AxisShaper, ShaperError, ShaperKind};

pub(crate) use plan_ring::MOST_IN_FILTER;
pub(crate) use stepper::{ShapedStepper, Standing};

use crate::time_units::TICKS_PER_SECOND;

/// The longest filter, ticks: 100 ms. What the machine executes is later than planned by no more than this.
pub const MAX_LENGTH_TICKS: u32 = TICKS_PER_SECOND / 10;

/// The filters of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaping {
    /// That of X.
    pub x: Kernel,
    /// That of Y.
    pub y: Kernel,
}

impl Shaping {
    /// No filters: every motor follows the plan itself.
    pub const NONE: Self = Self { x: Kernel::IDENTITY, y: Kernel::IDENTITY };

    /// The filters of these shapers of X and Y.
    ///
    /// # Errors
    /// The first shaper that cannot be made.
    pub fn new(shapers: &[AxisShaper; 2]) -> Result<Self, ShaperError> {
        let [x, y] = shapers;
        Ok(Self { x: x.kernel()?, y: y.kernel()? })
    }

    /// Whether anything is filtered.
    pub fn is_active(&self) -> bool {
        *self != Self::NONE
    }
}
