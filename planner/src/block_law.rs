//! What the time law of a block is asked for, whatever its kind.

use crate::real::Real;
use crate::s_curve::law::Along;
use crate::s_curve::staircase::Staircase;
use crate::spacing::Spacing;
use crate::step_times::StepTimes;
use crate::time_law::Trapezoid;

/// s(t) of a block: path in units of 10 nm, time in units of 2^-16 tick, both from its start.
pub(crate) trait BlockLaw<F: Real> {
    /// Path length of the block.
    fn length(&self) -> F;

    /// Its reciprocal.
    fn per_length(&self) -> F;

    /// Starts with the steps of a motor along the block, none of them due before `earliest`.
    fn start(&self, times: &mut StepTimes, steps: &Spacing<F>, earliest: u64);
}

impl<F: Real> BlockLaw<F> for Trapezoid<F> {
    #[inline]
    fn length(&self) -> F {
        self.length
    }

    #[inline]
    fn per_length(&self) -> F {
        self.per_length
    }

    #[inline]
    fn start(&self, times: &mut StepTimes, steps: &Spacing<F>, earliest: u64) {
        times.start(self, steps, earliest);
    }
}

/// A law that knows these figures by itself, and how its steps are started.
macro_rules! law {
    ($law:ident, $start:ident) => {
        impl BlockLaw<f64> for $law {
            fn length(&self) -> f64 {
                self.length
            }

            fn per_length(&self) -> f64 {
                1.0 / self.length
            }

            fn start(&self, times: &mut StepTimes, steps: &Spacing<f64>, earliest: u64) {
                times.$start(self, steps, earliest);
            }
        }
    };
}

law!(Along, start_run);
law!(Staircase, start_staircase);
