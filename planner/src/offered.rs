//! The methods that this build has.
//!
//! Every method on the desk and on the bench. A printer's image has its profile's: flash is finite, and what it lacks
//! is refused by name. A type that holds one of these markers has no values where the method is left out, so the
//! compiler leaves out what would act on it.

#[cfg(not(feature = "s-curves"))]
use core::convert::Infallible;

/// The S-curve and its table are there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct SCurves(#[cfg(not(feature = "s-curves"))] Infallible);

impl SCurves {
    /// The marker, if they are.
    #[cfg(feature = "s-curves")]
    pub const OFFERED: Option<Self> = Some(Self());
    /// The marker, if they are.
    #[cfg(not(feature = "s-curves"))]
    pub const OFFERED: Option<Self> = None;
}

/// Whether other ways to interpolate than step Bresenham are there.
pub(crate) const INTERPOLATIONS: bool = cfg!(feature = "interpolations");
