//! Finds the frame's mode in a spectrum.

use std::fmt;

use serde::Serialize;

use crate::least_squares::fit;
use crate::spectrum::Spectrum;

/// Range in which the mode is searched for, Hz.
const SEARCH_HZ: [f64; 2] = [10.0, 200.0];

/// Range of the lines that the curve is fitted to, relative to the peak's frequency.
const AROUND: [f64; 2] = [0.72, 1.35];

/// Minimum density of a peak relative to its surroundings, which are the geometric mean of the
/// densities at its frequency times and divided by [`BESIDE`].
const LEAST_PEAK: f64 = 3.0;
const BESIDE: f64 = 1.6;

/// Minimum density, relative to the strongest peak's, of another peak that is reported.
pub const SECOND_PEAK_SHARE: f64 = 0.1;

/// Power of a single frequency under Hann's window, by the distance from it in lines.
const WINDOW: [(f64, f64); 7] =
    [(-1.5, 0.0144), (-1.0, 0.25), (-0.5, 0.7205), (0.0, 1.0), (0.5, 0.7205), (1.0, 0.25), (1.5, 0.0144)];

/// Factor by which an interval is wider than for independent lines: neighbouring lines are not
/// independent under Hann's window, and a sweep passes each frequency only once.
const WIDER: f64 = 2.0;

/// Minimum relative uncertainties of frequency and damping, because a frame has more than one mode:
/// a second mode at 1.7 times the frequency with a quarter of the motion shifts them by this much.
const ONE_MODE: [f64; 2] = [0.004, 0.2];

/// Damping ratio assumed for a printer whose damping is unknown.
const USUAL_DAMPING: f64 = 0.1;

/// Half width of an interval that holds 95 %, in standard deviations.
const TWO_SIDED_95: f64 = 1.96;

/// Mode of a frame, with the half widths of intervals that hold 95 % of measurements.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Mode {
    /// Undamped frequency, Hz.
    pub frequency_hz: f64,
    /// Uncertainty of the frequency, Hz.
    pub frequency_uncertainty_hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Uncertainty of the damping ratio.
    pub damping_uncertainty: f64,
    /// Other peaks with at least [`SECOND_PEAK_SHARE`] of the density: frequency, Hz, and relative
    /// density.
    pub others: Vec<[f64; 2]>,
}

/// Reason why no mode was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeError {
    /// No peak stands out between the lowest and the highest frequency.
    NoPeak,
    /// The peak does not have the shape of a mode.
    Shape,
    /// The waves on the print do not fit any frame.
    Waves,
}

impl fmt::Display for ModeError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = SEARCH_HZ;
        match self {
            Self::NoPeak => write!(
                out,
                "no frequency between {low} and {high} Hz stands out: shake the axis harder, or fasten the accelerometer"
            ),
            Self::Shape => out.write_str(
                "the peak has not the shape of one mode; record the axis again, moved over more frequencies or for longer",
            ),
            Self::Waves => write!(
                out,
                "these waves are no frequency between {low} and {high} Hz known to a half, expected the number of waves, the length \
                 over which they were counted, and the speed of the nozzle there"
            ),
        }
    }
}

impl std::error::Error for ModeError {}

impl Mode {
    /// Computes the mode that leaves `waves` waves over `over_mm` after a corner passed at
    /// `speed_mm_per_s`; the length is read to within `reading_mm`. A print does not show the
    /// damping well, so the usual damping is assumed.
    ///
    /// # Errors
    /// [`ModeError::Waves`].
    pub fn of_waves(waves: f64, over_mm: f64, reading_mm: f64, speed_mm_per_s: f64) -> Result<Self, ModeError> {
        let [low, high] = SEARCH_HZ;
        let frequency_hz = speed_mm_per_s * waves / over_mm;
        let part = reading_mm / over_mm;
        // NaN is in no range.
        if !(low..=high).contains(&frequency_hz) || !(0.0..=0.5).contains(&part) {
            return Err(ModeError::Waves);
        }
        Ok(Self {
            frequency_hz,
            frequency_uncertainty_hz: part.max(ONE_MODE[0]) * frequency_hz,
            damping: USUAL_DAMPING,
            damping_uncertainty: USUAL_DAMPING,
            others: Vec::new(),
        })
    }

    /// Finds the strongest mode of a spectrum.
    ///
    /// The density of the acceleration of a mass on a spring that is moved at its other end is that
    /// of the movement times (1 + (2 zeta r)^2) / ((1 - r^2)^2 + (2 zeta r)^2), with r = f / f0.
    /// The density of the movement is assumed to be a power of f.
    ///
    /// # Errors
    /// [`ModeError`].
    pub fn of(spectrum: &Spectrum) -> Result<Self, ModeError> {
        let floor = spectrum.floor();
        let search = spectrum.lines(SEARCH_HZ);
        let smooth = |line: usize| {
            let around = line.saturating_sub(1)..(line + 2).min(spectrum.density.len());
            let count = around.len() as f64;
            spectrum.density[around].iter().sum::<f64>() / count
        };
        // Ratio of a line to its surroundings, whichever power of the frequency these follow.
        let beside = |line: usize, times: f64| smooth(((line as f64 * times) as usize).min(spectrum.density.len() - 1));
        let stands_out =
            |line: usize| smooth(line) / (beside(line, BESIDE) * beside(line, 1.0 / BESIDE)).sqrt().max(floor);
        let is_highest = |line: usize| {
            let reach = 2 + line / 10;
            let around = line.saturating_sub(reach)..(line + reach + 1).min(spectrum.density.len());
            around.into_iter().all(|other| smooth(other) <= smooth(line))
        };
        let peaks: Vec<usize> = search.filter(|line| stands_out(*line) > LEAST_PEAK && is_highest(*line)).collect();
        let highest = peaks.iter().copied().max_by(|a, b| smooth(*a).total_cmp(&smooth(*b)));
        let peak = highest.ok_or(ModeError::NoPeak)?;
        let peak_hz = spectrum.frequency_hz(peak);
        let lines = spectrum.lines(AROUND.map(|part| part * peak_hz));
        let start = [smooth(peak).ln() - 5.0, 2.0, peak_hz.ln(), 0.08f64.ln()];
        let residuals = |parameters: &[f64; 4]| -> Vec<f64> {
            let lines = lines.clone();
            let curve = |line: usize| (density(parameters, peak_hz, spectrum, line) + floor).ln();
            lines.map(|line| curve(line) - spectrum.density[line].max(f64::MIN_POSITIVE).ln()).collect()
        };
        let fit = fit(start, residuals).ok_or(ModeError::Shape)?;
        let [_, _, log_frequency, log_damping] = fit.parameters;
        let (frequency_hz, damping) = (log_frequency.exp(), log_damping.exp());
        let half = |index: usize| WIDER * TWO_SIDED_95 * fit.covariance[index][index].sqrt();
        let (frequency_part, damping_part) = (half(2), half(3));
        let [frequency_least, damping_least] = ONE_MODE;
        // NaN fails these comparisons and is refused like other values.
        let is_mode = (frequency_hz / peak_hz - 1.0).abs() < 0.2 && damping < 0.7 && frequency_part < 0.2;
        if !is_mode {
            return Err(ModeError::Shape);
        }
        let others = peaks
            .into_iter()
            .filter(|line| !lines.contains(line))
            .map(|line| [spectrum.frequency_hz(line), smooth(line) / smooth(peak)])
            .filter(|[_, share]| *share >= SECOND_PEAK_SHARE)
            .collect();
        Ok(Self {
            frequency_hz,
            frequency_uncertainty_hz: frequency_part.max(frequency_least) * frequency_hz,
            damping,
            damping_uncertainty: damping_part.max(damping_least) * damping,
            others,
        })
    }
}

/// Returns the density that a mode has at a line, as the window shows it.
fn density(
    [log_scale, power, log_frequency, log_damping]: &[f64; 4],
    peak_hz: f64,
    spectrum: &Spectrum,
    line: usize,
) -> f64 {
    let (mode_hz, damping) = (log_frequency.exp(), log_damping.exp());
    let mut sum = 0.0;
    let mut weights = 0.0;
    for (offset, weight) in WINDOW {
        let frequency_hz = (line as f64 + offset) * spectrum.step_hz;
        let r = frequency_hz / mode_hz;
        let twice = (2.0 * damping * r).powi(2);
        let response = (1.0 + twice) / ((1.0 - r * r).powi(2) + twice);
        sum += weight * (log_scale + power * (frequency_hz / peak_hz).ln()).exp() * response;
        weights += weight;
    }
    sum / weights
}
