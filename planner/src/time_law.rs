//! s(t) of a block, whatever its law: a value that yields the pieces.

use crate::block::{PlannedBlock, Speed};
use crate::piece::{Place, time_at};
use crate::pieces::{Never, OtherLaw, Pieces};
use crate::real::Real;
use crate::s_curve::law::{Along, Curve};
use crate::time_units::UNITS_PER_SECOND;
use crate::trapezoid::Trapezoid;

/// The longest duration of a block whose law is worked out in f32, in time units: a quarter of a
/// second. Its steps are then within a few ticks of f64's, a small part of the microsecond (84
/// ticks) that is allowed.
const MAX_IN_F32: f32 = 0.25 * UNITS_PER_SECOND as f32;

/// The time law of a block: a trapezoid, in the precision that its duration asks for, or another.
#[derive(Clone, Copy, Debug)]
pub enum TimeLaw<P = Never> {
    /// A trapezoid of at most a quarter of a second.
    Short(Trapezoid<f32>),
    /// A longer one.
    Long(Trapezoid<f64>),
    /// A block of a run under an S-curve.
    Run(Along),
    /// A law of another kind.
    Other(OtherLaw<P>),
}

impl<P: Pieces> TimeLaw<P> {
    /// The trapezoid of a planned block, Wu 2024.
    #[inline]
    pub fn trapezoid(planned: &PlannedBlock) -> Self {
        let short = Trapezoid::<f32>::new(planned);
        if short.duration <= MAX_IN_F32 { Self::Short(short) } else { Self::long(planned) }
    }

    // R3.
    #[cold]
    #[inline(never)]
    fn long(planned: &PlannedBlock) -> Self {
        Self::Long(Trapezoid::new(planned))
    }

    /// The law of a run along one of its blocks, which begins `offset_10nm` after the run's start,
    /// and the speed at the block's end (Li 2017).
    pub fn along(curve: &Curve, offset_10nm: u32, length_10nm: u32) -> (Self, Speed) {
        let law = Along::new(curve, offset_10nm, length_10nm);
        (Self::Run(law), law.exit())
    }

    /// Time at a path position, time units from the block's start; positions outside
    /// become the nearer end.
    pub(crate) fn time_at(&self, length_10nm: u32) -> u64 {
        match self {
            Self::Short(law) => law.time_at(length_10nm),
            Self::Long(law) => law.time_at(length_10nm),
            Self::Run(law) => law.time_at(length_10nm),
            Self::Other(law) => {
                let from_start = f64::from(length_10nm);
                Real::to_u64(time_at(law.pieces, &Place { from_start, to_end: law.length - from_start }))
            }
        }
    }

    /// Duration of the block in whole ticks, the nearest.
    pub fn duration_ticks(&self) -> u64 {
        match self {
            Self::Short(law) => law.duration_ticks(),
            Self::Long(law) => law.duration_ticks(),
            Self::Run(law) => law.duration_ticks(),
            Self::Other(law) => law.duration_ticks,
        }
    }
}
