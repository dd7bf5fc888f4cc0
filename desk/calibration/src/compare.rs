//! Compares shapers by the share of a measured vibration that each leaves.

use ferrostep_simulator::shapers::{Shaper, ShaperKind};
use serde::Serialize;

use crate::mode::Mode;
use crate::spectrum::Spectrum;

/// Range of the vibrations that count, Hz: in a print, lower frequencies do not show as ringing,
/// and higher ones hardly show.
const COUNTED_HZ: [f64; 2] = [5.0, 200.0];

/// Fraction of the highest density below which a density counts as part of the movement that shook
/// the frame, not as its vibration.
const COUNTED_PART: f64 = 0.05;

/// Kinds of shapers that are compared, shortest first.
const KINDS: [ShaperKind; 7] = [
    ShaperKind::Zv,
    ShaperKind::Mzv,
    ShaperKind::Zvd,
    ShaperKind::Ei,
    ShaperKind::Zvdd,
    ShaperKind::TwoHumpEi,
    ShaperKind::ThreeHumpEi,
];

/// Minimum change of a frame's frequency from print to print to allow for, as a fraction.
const LEAST_CHANGE: f64 = 0.02;

/// Maximum share of the vibration that a good shaper leaves.
const GOOD: f64 = 0.05;

/// Ratio of consecutive frequencies that are tried.
const NEXT_FREQUENCY: f64 = 1.004;

/// Effect of a shaper on the measured frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Name of the shaper in a profile.
    pub kind: String,
    /// Frequency to make the shaper for, Hz: the one at which it leaves least.
    pub frequency_hz: f64,
    /// Share of the recorded vibration's amplitude that the shaper leaves: the worst of the frame
    /// as measured, and of one stiffer or softer by [`Comparison::change`].
    pub left: f64,
    /// Rounding of a curve for each mm/s^2 of acceleration, s^2: half the shaper's variance.
    pub rounding_s2: f64,
}

/// Scores of the shapers, shortest first, and the one to use.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Damping ratio that all shapers are made for, within their ranges.
    pub damping: f64,
    /// Change of the frame's frequency to allow for, as a fraction.
    pub change: f64,
    /// Score of each kind at its best frequency.
    pub scores: Vec<Score>,
    /// Choice of the score to use.
    pub choice: Choice,
}

impl Comparison {
    /// Returns the damping ratio that a score's shaper is made for.
    pub fn damping_of(&self, score: &Score) -> f64 {
        let kind: Option<ShaperKind> = score.kind.parse().ok();
        kind.map_or(self.damping, |kind| self.damping.min(kind.max_damping()))
    }

    /// Returns the shaper of a score.
    pub fn shaper(&self, score: &Score) -> Option<Shaper> {
        Shaper::new(score.kind.parse().ok()?, score.frequency_hz, self.damping_of(score)).ok()
    }
}

/// Choice of the shaper to use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "reason", content = "index")]
pub enum Choice {
    /// Index of the shaper that rounds least among those that leave at most a twentieth.
    RoundsLeast(usize),
    /// Index of the shaper that leaves least, if none leaves at most a twentieth.
    LeavesLeast(usize),
}

impl Choice {
    /// Returns the index of the score.
    pub const fn index(self) -> usize {
        match self {
            Self::RoundsLeast(index) | Self::LeavesLeast(index) => index,
        }
    }
}

/// Applies all shapers to the vibration in a spectrum, or without a spectrum to the mode's
/// vibration alone. Each shaper is made for the mode's damping and the frequency at which it leaves
/// least. The one chosen rounds least among those that leave at most a twentieth.
pub fn compare(spectrum: Option<&Spectrum>, mode: &Mode) -> Comparison {
    let change = (mode.frequency_uncertainty_hz / mode.frequency_hz).max(LEAST_CHANGE);
    let vibration = spectrum.map_or_else(|| vec![(mode.frequency_hz, 1.0)], vibration);
    let scores: Vec<Score> = KINDS.iter().filter_map(|kind| best(*kind, mode, change, &vibration)).collect();
    let by = |key: fn(&Score) -> f64| move |a: &(usize, &Score), b: &(usize, &Score)| key(a.1).total_cmp(&key(b.1));
    let good = scores.iter().enumerate().filter(|(_, score)| score.left <= GOOD).min_by(by(|score| score.rounding_s2));
    let choice = match good {
        Some((index, _)) => Choice::RoundsLeast(index),
        None => {
            let least = scores.iter().enumerate().min_by(by(|score| score.left));
            Choice::LeavesLeast(least.map_or(0, |(index, _)| index))
        }
    };
    Comparison { damping: mode.damping, change, scores, choice }
}

/// Returns frequencies, Hz, and the density at each that counts as vibration.
fn vibration(spectrum: &Spectrum) -> Vec<(f64, f64)> {
    let lines = spectrum.lines(COUNTED_HZ);
    let highest = spectrum.density[lines.clone()].iter().copied().fold(0.0, f64::max);
    let threshold = spectrum.floor().max(COUNTED_PART * highest);
    lines.map(|line| (spectrum.frequency_hz(line), (spectrum.density[line] - threshold).max(0.0))).collect()
}

/// Scores a kind at the frequency at which it leaves least.
fn best(kind: ShaperKind, mode: &Mode, change: f64, vibration: &[(f64, f64)]) -> Option<Score> {
    let (low_hz, high_hz) = (0.6 * mode.frequency_hz, 1.7 * mode.frequency_hz);
    let frequencies =
        std::iter::successors(Some(low_hz), |hz| Some(hz * NEXT_FREQUENCY)).take_while(|hz| *hz < high_hz);
    let damping = mode.damping.min(kind.max_damping());
    frequencies
        .filter_map(|frequency_hz| {
            let shaper = Shaper::new(kind, frequency_hz, damping).ok()?;
            let left = [1.0 - change, 1.0, 1.0 + change].map(|stiffer| left(&shaper, stiffer, mode.damping, vibration));
            let left = left.into_iter().fold(0.0, f64::max);
            Some(Score { kind: kind.to_string(), frequency_hz, left, rounding_s2: 0.5 * shaper.variance_s2() })
        })
        .min_by(|a, b| a.left.total_cmp(&b.left))
}

/// Returns the share of the amplitude that a shaper leaves of vibrations with these frequencies and
/// densities, all frequencies multiplied by `stiffer`.
fn left(shaper: &Shaper, stiffer: f64, damping: f64, vibration: &[(f64, f64)]) -> f64 {
    let (mut left, mut all) = (0.0, 0.0);
    for (frequency_hz, density) in vibration {
        left += density * shaper.residual(stiffer * frequency_hz, damping).powi(2);
        all += density;
    }
    if all > 0.0 { (left / all).sqrt() } else { 0.0 }
}
