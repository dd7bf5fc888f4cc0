//! Computes what each shaper leaves of a measured vibration.

use ferrostep_simulator::shapers::{Shaper, ShaperKind};
use serde::Serialize;

use crate::mode::Mode;
use crate::spectrum::Spectrum;

/// Frequencies of vibrations that count, Hz: a print shows lower ones not as ringing, and
/// higher ones hardly.
const COUNTED_HZ: [f64; 2] = [5.0, 200.0];

/// Part of the highest density below which a density counts as the movement that shook the frame,
/// not as its vibration.
const COUNTED_PART: f64 = 0.05;

/// The kinds that are compared, the shortest first.
const KINDS: [ShaperKind; 7] = [
    ShaperKind::Zv,
    ShaperKind::Mzv,
    ShaperKind::Zvd,
    ShaperKind::Ei,
    ShaperKind::Zvdd,
    ShaperKind::TwoHumpEi,
    ShaperKind::ThreeHumpEi,
];

/// A frame is taken to change by at least this part of its frequency from print to print.
const LEAST_CHANGE: f64 = 0.02;

/// A shaper that leaves no more than this of the vibration is good enough.
const GOOD: f64 = 0.05;

/// A frequency is tried each time the one before times this.
const NEXT_FREQUENCY: f64 = 1.004;

/// Effect of a shaper on the measured frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// The name in a profile.
    pub kind: String,
    /// The frequency to make it for, Hz: that at which it leaves least.
    pub frequency_hz: f64,
    /// Amplitude that it leaves of the recorded vibration, as a part: the worst of the frame as
    /// measured, and of one that is stiffer or softer by [`Comparison::change`].
    pub left: f64,
    /// Rounding of a curve for each mm/s^2 of acceleration, s^2: half the shaper's variance.
    pub rounding_s2: f64,
}

/// The shapers, the shortest first, and the one to take.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Damping ratio that all are made for.
    pub damping: f64,
    /// Change of the frame's frequency to allow for, as a part of it.
    pub change: f64,
    /// Each kind with its best frequency.
    pub scores: Vec<Score>,
    /// The score to take.
    pub choice: Choice,
}

impl Comparison {
    /// The damping ratio that a score's shaper is made for.
    pub fn damping_of(&self, score: &Score) -> f64 {
        let kind: Option<ShaperKind> = score.kind.parse().ok();
        kind.map_or(self.damping, |kind| self.damping.min(kind.max_damping()))
    }

    /// The shaper of a score.
    pub fn shaper(&self, score: &Score) -> Option<Shaper> {
        Shaper::new(score.kind.parse().ok()?, score.frequency_hz, self.damping_of(score)).ok()
    }
}

/// The shaper to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "reason", content = "index")]
pub enum Choice {
    /// Index of the shaper that rounds least of those that leave at most a twentieth.
    RoundsLeast(usize),
    /// Index of the shaper that leaves least, where none leaves at most a twentieth.
    LeavesLeast(usize),
}

impl Choice {
    /// The index of the score.
    pub const fn index(self) -> usize {
        match self {
            Self::RoundsLeast(index) | Self::LeavesLeast(index) => index,
        }
    }
}

/// Plays all shapers on the vibration in a spectrum, or without one on the mode's alone. Each is
/// made for the mode's damping and the frequency at which it leaves least; the one to take rounds
/// least of those that leave at most a twentieth.
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

/// Frequencies, Hz, and the density at each that counts as vibration.
fn vibration(spectrum: &Spectrum) -> Vec<(f64, f64)> {
    let lines = spectrum.lines(COUNTED_HZ);
    let highest = spectrum.density[lines.clone()].iter().copied().fold(0.0, f64::max);
    let threshold = spectrum.floor().max(COUNTED_PART * highest);
    lines.map(|line| (spectrum.frequency_hz(line), (spectrum.density[line] - threshold).max(0.0))).collect()
}

/// A kind with the frequency at which it leaves least.
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

/// Amplitude that a shaper leaves of vibrations with these frequencies and densities, all of them
/// `stiffer` times as fast.
fn left(shaper: &Shaper, stiffer: f64, damping: f64, vibration: &[(f64, f64)]) -> f64 {
    let (mut left, mut all) = (0.0, 0.0);
    for (frequency_hz, density) in vibration {
        left += density * shaper.residual(stiffer * frequency_hz, damping).powi(2);
        all += density;
    }
    if all > 0.0 { (left / all).sqrt() } else { 0.0 }
}
