//! Commands that correct axes which are not at right angles.

use core::num::NonZeroU32;

use crate::Decimal;

/// Lengths of a printed parallelogram, in units of 10 nm: A is its first corner, D the one beside
/// it along the plane's first axis, B the one along its second axis, C the opposite one. Marlin's
/// and Klipper's letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Diagonals {
    /// The diagonal from A to C, in the direction in which both coordinates grow.
    pub ac_10nm: NonZeroU32,
    /// The diagonal from B to D.
    pub bd_10nm: NonZeroU32,
    /// The side along the plane's first axis.
    pub ad_10nm: NonZeroU32,
}

/// M852 and Klipper's words for it. What is of three planes is of XY, XZ and YZ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SkewCommand {
    /// M852 I (or S), J and K: the factors; without words a query.
    Factors([Option<Decimal>; 3]),
    /// SET_SKEW XY, XZ and YZ: measurements of some planes.
    Measured([Option<Diagonals>; 3]),
    /// SET_SKEW CLEAR=1: the axes are at right angles.
    Clear,
    /// CALC_MEASURED_SKEW: what the factor would be.
    Calculate(Diagonals),
    /// GET_CURRENT_SKEW: a query.
    Report,
}

impl SkewCommand {
    /// True if the axes may be off their right angles after it.
    pub fn may_skew(&self) -> bool {
        match self {
            Self::Factors(factors) => factors.iter().flatten().any(|factor| *factor != Decimal::ZERO),
            Self::Measured(_) => true,
            Self::Clear | Self::Calculate(_) | Self::Report => false,
        }
    }

    /// True if the command has no effect.
    pub const fn is_query(&self) -> bool {
        matches!(self, Self::Factors([None, None, None]) | Self::Calculate(_) | Self::Report)
    }
}
