//! Speed that changes at a constant jerk (Li 2017): an acceleration that rises from zero and falls back to it.
//!
//! Li's five segments are a ramp up, a cruise and a ramp down, each ramp two halves of the jerks +j and -j. [`Ramp`] is
//! one of them in closed form, [`Profile`] the whole, [`FrequencyTable`] Li's table of the same curve, [`Plan`] his
//! cases (a) to (d) of a segment between others, [`Segments`] his ring of them. The machine runs on the first two under
//! `acceleration = "s-curve"` and on the next two under `"s-curve-table"`.
//!
//! Any unit of length may stand for the path's: millimetres, or steps for the paper's frequencies.

pub(crate) mod bounds;
pub(crate) mod cubic;
pub(crate) mod law;
pub(crate) mod run;
pub(crate) mod staircase;

mod closed_form;
mod plan;
mod segments;
mod table;

pub use closed_form::{Profile, Ramp, State};
pub use plan::{Plan, PlanCase};
pub use run::{Jerk, Run};
pub use segments::{Line, Segment, Segments};
pub use table::{FrequencyTable, Slice};

use core::fmt;

/// Why there is no S-curve of what was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CurveError {
    /// The jerk is not a finite number above zero.
    Jerk,
    /// The acceleration is not a number above zero.
    Acceleration,
    /// A speed is not a finite number of at least zero.
    Speed,
    /// The length is not a finite number of at least zero.
    Length,
    /// The speeds at the ends are further apart than the length allows.
    TooShort,
    /// The start frequency is not a finite number above zero.
    StartFrequency,
    /// The highest frequency is not a finite number above the start frequency.
    TopFrequency,
    /// The table would have more slices than it may.
    TooManySlices,
}

impl fmt::Display for CurveError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Jerk => "the jerk must be a finite number above zero",
            Self::Acceleration => "the acceleration must be a number above zero",
            Self::Speed => "a speed must be a finite number of at least zero",
            Self::Length => "the length must be a finite number of at least zero",
            Self::TooShort => "the length is too short for the speeds at its ends",
            Self::StartFrequency => "the start frequency must be a finite number above zero",
            Self::TopFrequency => "the highest frequency must be a finite number above the start frequency",
            Self::TooManySlices => "the table would have more than 65536 slices",
        })
    }
}

impl core::error::Error for CurveError {}
