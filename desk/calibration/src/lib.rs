//! Derives a printer's frame from measurements: its frequencies, and the shapers for them.
//!
//! A [`Record`] of an accelerometer gives a [`Spectrum`] (Welch 1967), the spectrum a [`Mode`]:
//! frequency and damping with their uncertainty. [`compare()`] plays every shaper on the measured
//! vibration and says what each leaves of it.
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
