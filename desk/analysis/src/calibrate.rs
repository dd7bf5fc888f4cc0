//! Profile keys from measurements of a printer.

pub mod advance;
pub mod chart;
pub mod flow;
pub mod pattern;
pub mod speed;

use std::fmt;
use std::path::Path;

use ferrostep_calibration::{
    AXES, Choice, Comparison, Mode, ModeError, Record, RecordError, Spectrum, SpectrumError, compare,
};
use serde::Serialize;

/// Acceleration for which the rounding of a curve is reported, mm/s^2.
const EXAMPLE_ACCELERATION_MM_PER_S2: f64 = 5000.0;

/// The largest record that is read, bytes: ten minutes of an accelerometer.
const LARGEST_BYTES: u64 = 256 << 20;

/// Measurement of an axis and its frame.
#[derive(Clone, Debug, Serialize)]
pub struct FrameMeasurement {
    /// Source of the measurement, for a person.
    pub source: String,
    /// The axis, `X` or `Y`.
    pub axis: char,
    /// The measured frame.
    pub mode: Mode,
    /// The shapers for it.
    pub shapers: Comparison,
    /// Spectrum of the record, for the chart.
    #[serde(skip)]
    pub spectrum: Option<Spectrum>,
}

/// Reason for which a measurement cannot be used.
#[derive(Debug)]
pub enum CalibrationError {
    /// The file cannot be read.
    File(std::io::Error),
    /// The file is larger than any record.
    TooLarge,
    /// The file is not a record.
    Record(RecordError),
    /// The record has no spectrum.
    Spectrum(SpectrumError),
    /// The spectrum has no mode.
    Mode(ModeError),
}

impl fmt::Display for CalibrationError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(error) => error.fmt(out),
            Self::TooLarge => {
                write!(out, "more than {} MB, expected a record of an accelerometer", LARGEST_BYTES >> 20)
            }
            Self::Record(error) => error.fmt(out),
            Self::Spectrum(error) => error.fmt(out),
            Self::Mode(error) => error.fmt(out),
        }
    }
}

impl std::error::Error for CalibrationError {}

/// The frame along an axis (its index), from a record of an accelerometer.
///
/// # Errors
/// [`CalibrationError`].
pub fn from_record(file: &Path, axis: usize) -> Result<FrameMeasurement, CalibrationError> {
    let length = std::fs::metadata(file).map_err(CalibrationError::File)?.len();
    if length > LARGEST_BYTES {
        return Err(CalibrationError::TooLarge);
    }
    let bytes = std::fs::read(file).map_err(CalibrationError::File)?;
    let record = Record::parse(&String::from_utf8_lossy(&bytes)).map_err(CalibrationError::Record)?;
    let spectrum = Spectrum::of(&record, axis).map_err(CalibrationError::Spectrum)?;
    let mode = Mode::of(&spectrum).map_err(CalibrationError::Mode)?;
    let source = format!(
        "{}, {:.1} s of {:.0} samples a second",
        ferrostep_host::printable::name(file),
        record.duration_s(),
        record.rate_hz
    );
    let shapers = compare(Some(&spectrum), &mode);
    Ok(FrameMeasurement { source, axis: AXES[axis], mode, shapers, spectrum: Some(spectrum) })
}

/// The frame along an axis (its index), from waves on a print: how many over which length, read to
/// `reading_mm`, at which speed.
///
/// # Errors
/// [`CalibrationError::Mode`].
pub fn from_waves(
    axis: usize,
    waves: f64,
    over_mm: f64,
    reading_mm: f64,
    speed_mm_per_s: f64,
) -> Result<FrameMeasurement, CalibrationError> {
    let mode = Mode::of_waves(waves, over_mm, reading_mm, speed_mm_per_s).map_err(CalibrationError::Mode)?;
    let source = format!("{waves} waves over {over_mm} mm at {speed_mm_per_s} mm/s");
    let shapers = compare(None, &mode);
    Ok(FrameMeasurement { source, axis: AXES[axis], mode, shapers, spectrum: None })
}

impl fmt::Display for FrameMeasurement {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { source, axis, mode, shapers, .. } = self;
        writeln!(out, "{source}")?;
        writeln!(
            out,
            "frame in {axis}  {:.2} Hz +- {:.2} Hz, damping {:.3} +- {:.3}",
            mode.frequency_hz, mode.frequency_uncertainty_hz, mode.damping, mode.damping_uncertainty
        )?;
        for [frequency_hz, share] in &mode.others {
            writeln!(out, "also        {frequency_hz:.1} Hz, with {:.0} % of the density", 100.0 * share)?;
        }
        writeln!(
            out,
            "\n{:<10} {:>9} {:>8}  rounds a curve at {EXAMPLE_ACCELERATION_MM_PER_S2} mm/s² by",
            "shaper", "for", "leaves"
        )?;
        for (index, score) in shapers.scores.iter().enumerate() {
            let mark = if index == shapers.choice.index() { '*' } else { ' ' };
            let rounding_mm = score.rounding_s2 * EXAMPLE_ACCELERATION_MM_PER_S2;
            writeln!(
                out,
                "{:<9}{mark} {:>6.1} Hz {:>6.1} %  {rounding_mm:.3} mm",
                score.kind,
                score.frequency_hz,
                100.0 * score.left
            )?;
        }
        let Some(taken) = shapers.scores.get(shapers.choice.index()) else { return Ok(()) };
        let why = match shapers.choice {
            Choice::RoundsLeast(_) => "rounds least of those that leave at most 5 %",
            Choice::LeavesLeast(_) => "leaves least; none leaves as little as 5 %",
        };
        writeln!(
            out,
            "\n* {why}, of a frame as measured and {:.1} % stiffer or softer.\n\nIn the profile:\n\n[input_shaper.{axis}]\nkind = \
             \"{}\"\nfrequency_hz = {:.1}\ndamping = {:.3}\n\n[frame.{axis}]\nfrequency_hz = {:.1}\nfrequency_uncertainty_hz = \
             {:.1}\ndamping = {:.3}",
            100.0 * shapers.change,
            taken.kind,
            taken.frequency_hz,
            shapers.damping_of(taken),
            mode.frequency_hz,
            shapers.change * mode.frequency_hz,
            mode.damping,
            axis = axis.to_ascii_lowercase(),
        )
    }
}
