//! Derives the properties of a printer's frame from measurements: its frequencies, and the shapers
//! for them.
//!
//! A [`Record`] of an accelerometer gives a [`Spectrum`] (Welch 1967), and the spectrum a [`Mode`]:
//! frequency and damping with their uncertainty. [`compare()`] applies every shaper to the measured
//! vibration and reports the share that each leaves.
//!
//! Units are millimetres and seconds throughout.
#![forbid(unsafe_code)]

mod compare;
mod least_squares;
mod mode;
mod record;
mod spectrum;

pub use compare::{Choice, Comparison, Score, compare};
pub use mode::{Mode, ModeError, SECOND_PEAK_SHARE};
pub use record::{AXES, Record, RecordError};
pub use spectrum::{Spectrum, SpectrumError};
