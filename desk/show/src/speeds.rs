//! Speeds of samples: over as long a time as the speed changes evenly, for steps make the speed
//! over a short time coarse.

use std::collections::VecDeque;

use crate::path::Place;

/// Maximum number of samples to either side over which a speed is measured.
const MAX_REACH: usize = 64;
/// Part of a motor's step by which the path between two samples may be wrong: a motor of which a
/// curve asks for few steps makes them early or late.
const WRONG_STEPS: f64 = 0.5;
/// Samples on one side lie on a straight line if they are no farther from it than this part of a
/// step. Along a line every motor steps evenly.
const STRAIGHT_STEPS: f64 = 0.05;
/// Shortest line that tells a line from a curve, mm.
const LINE_MM: f64 = 1.0;

/// A sample, and the line whose move ends there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ending {
    pub place: Place,
    pub ends: Option<u32>,
}

/// A sample with the length of all of the path up to it, mm.
#[derive(Clone, Copy, Debug)]
struct Along {
    sample: Ending,
    along_mm: f64,
}

/// Gives each sample its speed when the samples after it are known.
#[derive(Debug)]
pub(crate) struct Speeds {
    samples: VecDeque<Along>,
    /// Index of the next sample whose speed is asked for.
    next: usize,
    step_mm: f64,
}

impl Speeds {
    /// `step_mm`: the longest step of a motor of X, Y or Z.
    pub fn new(step_mm: f64, start: Place) -> Self {
        let start = Along { sample: Ending { place: start, ends: None }, along_mm: 0.0 };
        Self { samples: VecDeque::from([start]), next: 1, step_mm }
    }

    /// Starts again at another place. All samples have been taken.
    pub fn begin(&mut self, place: Place) {
        *self = Self::new(self.step_mm, place);
    }

    /// The last sample.
    pub fn last(&self) -> Place {
        self.samples.back().map_or(Place::default(), |last| last.sample.place)
    }

    pub fn push(&mut self, sample: Ending) {
        let Some(last) = self.samples.back() else { return };
        let along_mm = last.along_mm + last.sample.place.distance_mm(&sample.place);
        self.samples.push_back(Along { sample, along_mm });
    }

    /// The next sample, and its speed, mm/s; with `is_at_rest` also those without enough
    /// samples after them.
    pub fn pop(&mut self, is_at_rest: bool) -> Option<(Ending, f64)> {
        let after = self.samples.len().checked_sub(self.next + 1)?;
        if after < MAX_REACH && !is_at_rest {
            return None;
        }
        let speed_mm_per_s = self.speed_mm_per_s(self.next);
        let sample = self.samples.get(self.next)?.sample;
        self.next += 1;
        if self.next > MAX_REACH {
            self.samples.pop_front();
            self.next -= 1;
        }
        Some((sample, speed_mm_per_s))
    }

    /// The speed over the longest time around a sample that agrees with all shorter ones, as far as
    /// steps allow to tell.
    fn speed_mm_per_s(&self, at: usize) -> f64 {
        let max_reach = if self.is_straight(at) { 1 } else { MAX_REACH };
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut speed = 0.0;
        let mut reach = 1;
        while reach <= max_reach {
            let first = self.samples.get(at.saturating_sub(reach));
            // After the last sample the motors rest.
            let last = self.samples.get((at + reach).min(self.samples.len() - 1));
            let Some((first, last)) = first.zip(last) else { break };
            let time_s = last.sample.place.time_s - first.sample.place.time_s;
            if time_s <= 0.0 || reach > 1 && (at < reach || at + reach >= self.samples.len()) {
                break;
            }
            let found = (last.along_mm - first.along_mm) / time_s;
            let wrong = WRONG_STEPS * self.step_mm / time_s;
            (low, high) = (low.max(found - wrong), high.min(found + wrong));
            if low > high {
                break;
            }
            speed = found;
            reach *= 2;
        }
        speed
    }

    /// Returns true if the samples after this one, or those before it, lie on a straight line.
    fn is_straight(&self, at: usize) -> bool {
        let place = |index: usize| Some(self.samples.get(index)?.sample.place.position_mm);
        let side = |of: &dyn Fn(usize) -> Option<usize>| {
            let (start, end) = (place(at)?, place(of(MAX_REACH)?)?);
            let between = [1, 2, 3].map(|quarter| place(of(quarter * MAX_REACH / 4)?));
            let is_near = |place: Option<[f64; 3]>| {
                place.is_some_and(|place| distance_mm(place, start, end) <= STRAIGHT_STEPS * self.step_mm)
            };
            let is_long = (0..3).map(|axis| (end[axis] - start[axis]).powi(2)).sum::<f64>() > LINE_MM * LINE_MM;
            Some(is_long && between.into_iter().all(is_near))
        };
        side(&|by| at.checked_add(by)) == Some(true) || side(&|by| at.checked_sub(by)) == Some(true)
    }
}

/// Distance of a place from the line through two others, mm; from the first of them if
/// they are the same.
fn distance_mm(place: [f64; 3], start: [f64; 3], end: [f64; 3]) -> f64 {
    let [along, off] = [end, place].map(|other| -> [f64; 3] { std::array::from_fn(|axis| other[axis] - start[axis]) });
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let square = dot(along, along);
    let share = if square > 0.0 { dot(off, along) / square } else { 0.0 };
    let rest: [f64; 3] = std::array::from_fn(|axis| off[axis] - share * along[axis]);
    dot(rest, rest).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of each millisecond along a curve, with steps that are early and late in turn.
    fn speeds(along_mm: impl Fn(f64) -> f64, samples: u16) -> Vec<f64> {
        let mut speeds = Speeds::new(0.0125, Place::default());
        for sample in 1..=samples {
            let time_s = f64::from(sample) * 1e-3;
            let exact = along_mm(time_s) / 0.0125;
            let x = 0.0125 * (exact + 0.2 * (exact * std::f64::consts::PI).sin());
            let (sine, cosine) = (x / 20.0).sin_cos();
            let position_mm = [20.0 * sine, 20.0 * cosine - 20.0, 0.0];
            speeds.push(Ending { place: Place { time_s, position_mm, ..Place::default() }, ends: None });
        }
        std::iter::from_fn(|| speeds.pop(true)).map(|(_, speed)| speed).collect()
    }

    #[test]
    fn a_steady_speed_is_told_to_a_hundredth_though_steps_are_coarse() {
        for expected in [5.0, 30.0, 100.0] {
            for speed in &speeds(|time_s| expected * time_s, 1000)[100..900] {
                assert!((speed / expected - 1.0).abs() < 0.02, "{speed} mm/s, expected {expected}");
            }
        }
    }

    #[test]
    fn a_ramp_and_its_end_are_followed() {
        // To 50 mm/s within 50 ms, and on at that speed.
        let along = |time_s: f64| if time_s < 0.05 { 500.0 * time_s * time_s } else { 1.25 + 50.0 * (time_s - 0.05) };
        for (sample, speed) in speeds(along, 200).iter().enumerate().take(190).skip(5) {
            let expected = 1000.0 * (1e-3 * (sample + 1) as f64).min(0.05);
            assert!((speed - expected).abs() < 4.0, "{sample} ms: {speed} mm/s, expected {expected}");
        }
    }

    /// Along a straight line speeds are those from sample to sample: nothing is rounded off at
    /// the end of a ramp.
    #[test]
    fn the_end_of_a_ramp_is_sharp_on_a_line() {
        let mut speeds = Speeds::new(0.0125, Place::default());
        for sample in 1..=300_u16 {
            let time_s = f64::from(sample) * 1e-3;
            let x = if time_s < 0.05 { 500.0 * time_s * time_s } else { 1.25 + 50.0 * (time_s - 0.05) };
            let place = Place { time_s, position_mm: [0.6 * x, 0.8 * x, 0.0], ..Place::default() };
            speeds.push(Ending { place, ends: None });
        }
        let speeds: Vec<f64> = std::iter::from_fn(|| speeds.pop(true)).map(|(_, speed)| speed).collect();
        for (sample, speed) in speeds.iter().enumerate().take(250).skip(1) {
            let expected = (sample + 1) as f64;
            assert!((speed - expected.min(50.0)).abs() < 0.3, "{sample} ms: {speed} mm/s");
        }
    }

    #[test]
    fn every_sample_comes_once_and_in_order() {
        let mut speeds = Speeds::new(0.0125, Place::default());
        let mut seen = Vec::new();
        for line in 0..500_u32 {
            let place = Place { time_s: f64::from(line + 1) * 1e-3, ..Place::default() };
            speeds.push(Ending { place, ends: Some(line) });
            seen.extend(std::iter::from_fn(|| speeds.pop(false)).filter_map(|(sample, _)| sample.ends));
        }
        assert!(seen.len() > 400 && speeds.samples.len() <= 2 * MAX_REACH + 2);
        seen.extend(std::iter::from_fn(|| speeds.pop(true)).filter_map(|(sample, _)| sample.ends));
        assert_eq!(seen, (0..500).collect::<Vec<_>>());
    }
}
