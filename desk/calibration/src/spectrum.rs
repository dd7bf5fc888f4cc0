//! Spectrum of a record by Welch's method.

use std::f64::consts::TAU;
use std::fmt;

use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

use crate::record::{AXES, Record};

/// Minimum sampling rate, Hz: twice the highest frequency that shapers are made for, plus a margin
/// for the filter ahead of the converter.
const LEAST_RATE_HZ: f64 = 500.0;

/// Minimum duration of a record, s.
const LEAST_DURATION_S: f64 = 2.0;

/// Minimum duration of a part, s, so that lines are less than 1 Hz apart.
const PART_S: f64 = 1.0;

/// Minimum power of the axis that the machine moved, relative to the strongest axis.
const OWN_SHARE: f64 = 0.25;

/// Range of frequencies by which the power of an axis is judged, Hz.
const BAND_HZ: [f64; 2] = [10.0, 200.0];

/// Power density of an axis's acceleration, (mm/s^2)^2/Hz, at the multiples of a frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// Distance between adjacent lines, Hz.
    pub step_hz: f64,
    /// Density at each line; the first line is at 0 Hz.
    pub density: Vec<f64>,
    /// Number of parts of the record that are averaged; they overlap by half.
    pub parts: usize,
}

/// Reason why a record has no usable spectrum.
#[derive(Clone, Debug, PartialEq)]
pub enum SpectrumError {
    /// The sampling rate is too low; the rate, Hz.
    Rate(f64),
    /// The record is too short; the duration, s.
    Duration(f64),
    /// Another axis vibrates more.
    OtherAxis {
        /// Axis that was asked for.
        axis: char,
        /// Axis that vibrates most.
        strongest: char,
        /// Power of the strongest axis, relative to the axis asked for.
        times: f64,
    },
    /// No axis vibrates.
    Still,
}

impl fmt::Display for SpectrumError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rate(rate_hz) => write!(
                out,
                "{rate_hz:.0} samples a second, expected at least {LEAST_RATE_HZ:.0}: set a higher rate of the accelerometer"
            ),
            Self::Duration(duration_s) => {
                write!(out, "{duration_s:.2} s long, expected at least {LEAST_DURATION_S} s: record more samples")
            }
            Self::OtherAxis { axis, strongest, times } => write!(
                out,
                "between {} and {} Hz {strongest} shakes with {times:.0} times the power of {axis}: this is a record of \
                 {strongest}, or the accelerometer is turned; give --axis {}",
                BAND_HZ[0],
                BAND_HZ[1],
                strongest.to_ascii_lowercase()
            ),
            Self::Still => {
                out.write_str("all samples are the same: nothing was shaken, or the accelerometer is not connected")
            }
        }
    }
}

impl std::error::Error for SpectrumError {}

impl Spectrum {
    /// Computes the spectrum of an axis, given by its index, which must be the one that was shaken.
    ///
    /// # Errors
    /// [`SpectrumError`].
    pub fn of(record: &Record, axis: usize) -> Result<Self, SpectrumError> {
        // NaN fails this comparison.
        let is_fast = record.rate_hz >= LEAST_RATE_HZ;
        if !is_fast {
            return Err(SpectrumError::Rate(record.rate_hz));
        }
        if record.duration_s() < LEAST_DURATION_S {
            return Err(SpectrumError::Duration(record.duration_s()));
        }
        let all = [0, 1, 2].map(|axis| welch(&record.acceleration_mm_per_s2[axis], record.rate_hz));
        let powers = [0, 1, 2].map(|axis| all[axis].power(BAND_HZ));
        let strongest = (0..3).max_by(|a, b| powers[*a].total_cmp(&powers[*b])).unwrap_or(axis);
        if powers[strongest] <= 0.0 {
            return Err(SpectrumError::Still);
        }
        if powers[axis] < OWN_SHARE * powers[strongest] {
            let times = powers[strongest] / powers[axis].max(f64::MIN_POSITIVE);
            return Err(SpectrumError::OtherAxis { axis: AXES[axis], strongest: AXES[strongest], times });
        }
        let [x, y, z] = all;
        Ok(match axis {
            0 => x,
            1 => y,
            _ => z,
        })
    }

    /// Returns the frequency of a line, Hz.
    pub fn frequency_hz(&self, line: usize) -> f64 {
        self.step_hz * line as f64
    }

    /// Returns the indices of the lines between two frequencies, Hz.
    pub fn lines(&self, [low_hz, high_hz]: [f64; 2]) -> std::ops::Range<usize> {
        let line = |frequency_hz: f64| ((frequency_hz / self.step_hz).ceil().max(1.0) as usize).min(self.density.len());
        line(low_hz)..line(high_hz).max(line(low_hz))
    }

    /// Returns the power between two frequencies, (mm/s^2)^2.
    pub fn power(&self, band_hz: [f64; 2]) -> f64 {
        self.density[self.lines(band_hz)].iter().sum::<f64>() * self.step_hz
    }

    /// Returns the density of the noise: the median at frequencies above those at which printers
    /// vibrate.
    pub fn floor(&self) -> f64 {
        let highest_hz = self.frequency_hz(self.density.len() - 1);
        let mut above: Vec<f64> = self.density[self.lines([0.7 * highest_hz, highest_hz])].to_vec();
        above.sort_by(f64::total_cmp);
        above.get(above.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Averages the spectra of overlapping parts, each without its mean and slope, under Hann's window
/// (Welch 1967).
fn welch(samples: &[f64], rate_hz: f64) -> Spectrum {
    let length = ((PART_S * rate_hz).ceil() as usize).next_power_of_two().min(prior_power_of_two(samples.len()));
    let window: Vec<f64> = (0..length).map(|at| 0.5 - 0.5 * (TAU * at as f64 / length as f64).cos()).collect();
    let transform = FftPlanner::<f64>::new().plan_fft_forward(length);
    let (mut part, mut lines) = (vec![0.0; length], vec![Complex::new(0.0, 0.0); length]);
    let mut density = vec![0.0; length / 2 + 1];
    let mut parts = 0_u32;
    for start in (0..=samples.len() - length).step_by(length / 2) {
        part.copy_from_slice(&samples[start..start + length]);
        remove_line(&mut part);
        for (line, (sample, weight)) in lines.iter_mut().zip(part.iter().zip(&window)) {
            *line = Complex::new(sample * weight, 0.0);
        }
        transform.process(&mut lines);
        density.iter_mut().zip(&lines).for_each(|(sum, line)| *sum += line.norm_sqr());
        parts += 1;
    }
    // The one-sided spectrum carries the power of both sides.
    let power_of_window: f64 = window.iter().map(|weight| weight * weight).sum();
    let scale = 2.0 / (rate_hz * power_of_window * f64::from(parts.max(1)));
    density.iter_mut().for_each(|one| *one *= scale);
    Spectrum { step_hz: rate_hz / length as f64, density, parts: parts as usize }
}

/// Subtracts the straight line through the samples.
fn remove_line(samples: &mut [f64]) {
    let count = samples.len() as f64;
    let middle = 0.5 * (count - 1.0);
    let mean = samples.iter().sum::<f64>() / count;
    let (mut product, mut square) = (0.0, 0.0);
    for (at, sample) in samples.iter().enumerate() {
        let from_middle = at as f64 - middle;
        product += from_middle * sample;
        square += from_middle * from_middle;
    }
    let slope = if square > 0.0 { product / square } else { 0.0 };
    samples.iter_mut().enumerate().for_each(|(at, sample)| *sample -= mean + slope * (at as f64 - middle));
}

/// Returns the largest power of two not above a number of at least 1.
fn prior_power_of_two(number: usize) -> usize {
    1 << (usize::BITS - 1 - number.max(1).leading_zeros())
}
