//! Li's table of frequencies.

use crate::curve_error::{CurveError, is_in_range};
use ferrostep_planner::SCurveTableSettings;
use ferrostep_planner::square_root::square_root;

/// Li's table (Li 2017, sect. 1.2): the S-curve from a start frequency f0 to a highest one, in
/// slices of T = 2/f0, each at a constant frequency, and F, the pulses made before each of them.
///
/// A slice has the frequency at its middle. The paper uses the frequency at its start, and then the
/// sum misses the 3300 pulses of the ramp in its experiment by 9; with the middles it is within one
/// pulse, since the midpoint rule is exact where the frequency changes linearly. The last slice
/// ends with the ramp.
///
/// The paper keeps the table in memory allocated at run time. Frequencies are quadratic and their
/// sums cubic in the slice's number, so this table is computed when it is read: it takes no memory,
/// whatever T is.
///
/// Deceleration is acceleration reversed and reads the same table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrequencyTable {
    start_hz: f64,
    top_hz: f64,
    jerk_hz_per_s2: f64,
    /// T, s.
    slice_s: f64,
    /// t1, the time of the greatest acceleration, s.
    half_time_s: f64,
    slices: u32,
    /// Number of slices whose middle is not after t1.
    early: u32,
}

/// A slice of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slice {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s; T, or the remainder for the last slice.
    pub duration_s: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// F, the number of pulses before the slice.
    pub pulses_before: f64,
}

impl FrequencyTable {
    /// Creates the table from `start_hz` to `top_hz` at a jerk in Hz/s^2.
    ///
    /// # Errors
    /// [`CurveError`] if a number is out of range, the frequencies do not rise, or T is so short
    /// that there would be more than 65,536 slices.
    pub fn new(start_hz: f64, top_hz: f64, jerk_hz_per_s2: f64) -> Result<Self, CurveError> {
        if !is_in_range(start_hz) {
            return Err(CurveError::StartFrequency);
        }
        if !(top_hz > start_hz && is_in_range(top_hz)) {
            return Err(CurveError::TopFrequency);
        }
        if !is_in_range(jerk_hz_per_s2) {
            return Err(CurveError::Jerk);
        }
        let slice_s = 2.0 / start_hz;
        // Li 2017, eq. 4.
        let half_time_s = square_root((top_hz - start_hz) / jerk_hz_per_s2);
        let slices = 2.0 * half_time_s / slice_s;
        if slices.is_nan() || slices > f64::from(SCurveTableSettings::MAX_SLICES) {
            return Err(CurveError::TooManySlices);
        }
        // No slice for a remainder that is only rounding.
        let slices = ((slices + (1.0 - 1e-9)) as u32).max(1);
        let early = ((half_time_s / slice_s + 0.5) as u32).min(slices - 1);
        Ok(Self { start_hz, top_hz, jerk_hz_per_s2, slice_s, half_time_s, slices, early })
    }

    /// f0, Hz.
    pub fn start_hz(&self) -> f64 {
        self.start_hz
    }

    /// Highest frequency, Hz.
    pub fn top_hz(&self) -> f64 {
        self.top_hz
    }

    /// T = 2/f0, s.
    pub fn slice_s(&self) -> f64 {
        self.slice_s
    }

    /// t1, half of the ramp's duration, s.
    pub fn half_time_s(&self) -> f64 {
        self.half_time_s
    }

    /// Number of slices.
    pub fn len(&self) -> usize {
        self.slices as usize
    }

    /// Returns true if there is no slice; the table always has one.
    pub fn is_empty(&self) -> bool {
        self.slices == 0
    }

    /// Returns a slice, numbered from 0; `None` after the last.
    pub fn slice(&self, index: u32) -> Option<Slice> {
        (index < self.slices).then(|| self.at(index))
    }

    /// All slices.
    pub fn iter(&self) -> impl Iterator<Item = Slice> + '_ {
        (0..self.slices).map(|index| self.at(index))
    }

    /// Number of pulses in the whole ramp.
    pub fn pulses(&self) -> f64 {
        self.pulses_before(self.slices)
    }

    /// Frequency of the S-curve itself (Li 2017, eq. 3) at a time of the ramp.
    pub fn frequency_at(&self, time_s: f64) -> f64 {
        let rest_s = 2.0 * self.half_time_s - time_s;
        if time_s <= 0.0 {
            self.start_hz
        } else if rest_s <= 0.0 {
            self.top_hz
        } else if time_s <= self.half_time_s {
            self.start_hz + 0.5 * self.jerk_hz_per_s2 * time_s * time_s
        } else {
            self.top_hz - 0.5 * self.jerk_hz_per_s2 * rest_s * rest_s
        }
    }

    /// Time at which the S-curve has a frequency; frequencies outside give the nearer end.
    pub fn time_of(&self, frequency_hz: f64) -> f64 {
        let gained = frequency_hz - self.start_hz;
        let missing = self.top_hz - frequency_hz;
        let time = |change_hz: f64| square_root(2.0 * change_hz / self.jerk_hz_per_s2);
        if gained <= 0.0 {
            0.0
        } else if missing <= 0.0 {
            2.0 * self.half_time_s
        } else if gained <= missing {
            time(gained)
        } else {
            2.0 * self.half_time_s - time(missing)
        }
    }

    /// F of a frequency: the number of pulses made when the S-curve reaches it, 0 at f0 and below.
    pub fn pulses_to(&self, frequency_hz: f64) -> f64 {
        let time_s = self.time_of(frequency_hz);
        let index = ((time_s / self.slice_s) as u32).min(self.slices - 1);
        let slice = self.at(index);
        slice.pulses_before + slice.frequency_hz * (time_s - slice.start_s)
    }

    /// Frequency of the S-curve after this many pulses, the inverse of F.
    pub fn frequency_after(&self, pulses: f64) -> f64 {
        self.frequency_at(self.time_after(pulses))
    }

    /// Time at which this many pulses have been made.
    pub fn time_after(&self, pulses: f64) -> f64 {
        if pulses <= 0.0 {
            return 0.0;
        }
        let slice = self.at(self.slice_of(pulses));
        let inside_s = (pulses - slice.pulses_before) / slice.frequency_hz;
        slice.start_s + if inside_s < slice.duration_s { inside_s } else { slice.duration_s }
    }

    /// Index of the slice in which a pulse is made.
    pub(crate) fn slice_of(&self, pulses: f64) -> u32 {
        let (mut low, mut high) = (0, self.slices);
        while high - low > 1 {
            let middle = low.midpoint(high);
            if self.pulses_before(middle) <= pulses { low = middle } else { high = middle }
        }
        low
    }

    /// Returns a slice; `index` must be in range.
    pub(crate) fn at(&self, index: u32) -> Slice {
        let start_s = f64::from(index) * self.slice_s;
        let rest_s = 2.0 * self.half_time_s - start_s;
        let duration_s = if index + 1 < self.slices { self.slice_s } else { rest_s };
        Slice {
            start_s,
            duration_s,
            frequency_hz: self.frequency_at(start_s + 0.5 * duration_s),
            pulses_before: self.pulses_before(index),
        }
    }

    /// F at the start of a slice; after the last, of the whole ramp.
    ///
    /// Sums of squares: sum over k < n of (k + 1/2)^2 = n^3/3 - n/12, and with H(x) = x^3/3 +
    /// x^2/2 + x/6, for which H(x)
    /// - H(x - 1) = x^2, sum over m <= k < n of (c - k)^2 = H(c - m) - H(c - n).
    fn pulses_before(&self, index: u32) -> f64 {
        let half_cube = 0.5 * self.jerk_hz_per_s2 * self.slice_s * self.slice_s * self.slice_s;
        let early = index.min(self.early);
        let n = f64::from(early);
        let mut pulses = n * self.start_hz * self.slice_s + half_cube * (n * n * n * (1.0 / 3.0) - n * (1.0 / 12.0));
        // The last slice may be shorter.
        let late = index.min(self.slices - 1);
        if late > early {
            let sum = |x: f64| x * (x * (x * (1.0 / 3.0) + 0.5) + 1.0 / 6.0);
            let from_end = 2.0 * self.half_time_s / self.slice_s - 0.5;
            let squares = sum(from_end - n) - sum(from_end - f64::from(late));
            pulses += f64::from(late - early) * self.top_hz * self.slice_s - half_cube * squares;
        }
        if index >= self.slices {
            let start_s = f64::from(self.slices - 1) * self.slice_s;
            let rest_s = 2.0 * self.half_time_s - start_s;
            pulses += rest_s * self.frequency_at(start_s + 0.5 * rest_s);
        }
        pulses
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    /// The paper's experiment.
    fn experiment() -> FrequencyTable {
        FrequencyTable::new(1_000.0, 10_000.0, 100_000.0).unwrap()
    }

    #[test]
    fn the_experiment_s_ramp() {
        let table = experiment();
        assert!((table.half_time_s() - 0.3).abs() < 1e-12);
        assert_eq!(table.len(), 300);
        // (f0 + f_max) t1.
        assert!((table.pulses() - 3_300.0).abs() < 1.0, "{}", table.pulses());
        // Frequencies at the starts of the slices, as in the paper.
        let at_starts: f64 = table.iter().map(|slice| table.frequency_at(slice.start_s) * slice.duration_s).sum();
        assert!((at_starts - 3_291.0).abs() < 0.5, "{at_starts}");
        assert!((100_000.0 * table.half_time_s() - 30_000.0).abs() < 1e-6);
    }

    #[test]
    fn bad_numbers_are_told() {
        let error = |f0, top, jerk| FrequencyTable::new(f0, top, jerk).unwrap_err();
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(error(bad, 10.0, 1.0), CurveError::StartFrequency);
            assert_eq!(error(1.0, bad, 1.0), CurveError::TopFrequency);
            assert_eq!(error(1.0, 10.0, bad), CurveError::Jerk);
        }
        assert_eq!(error(10.0, 10.0, 1.0), CurveError::TopFrequency);
        assert_eq!(error(10.0, 9.0, 1.0), CurveError::TopFrequency);
        assert_eq!(error(1e6, 2e6, 1e-3), CurveError::TooManySlices);
        assert_eq!(error(1.0, 1e12, 1e-12), CurveError::TooManySlices);
        assert_eq!(error(1.0, f64::MAX, 1.0), CurveError::TopFrequency);
        assert_eq!(error(1.0, 10.0, f64::MIN_POSITIVE), CurveError::Jerk);
    }

    /// Any float, more often a plausible one.
    fn wide() -> impl Strategy<Value = f64> {
        prop_oneof![1 => any::<f64>(), 8 => (-13.0f64..13.0).prop_map(|exponent| 10f64.powf(exponent))]
    }

    fn tables() -> impl Strategy<Value = FrequencyTable> {
        (50.0f64..5_000.0, 1.0f64..300.0, 4.0f64..8.0)
            .prop_map(|(f0, times, jerk)| FrequencyTable::new(f0, f0 * (1.0 + times), 10f64.powf(jerk)).unwrap())
    }

    proptest! {
        #[test]
        fn whatever_is_asked_is_answered_or_refused(
            start in wide(), top in wide(), jerk in wide(), asked in any::<f64>(),
        ) {
            if let Ok(table) = FrequencyTable::new(start, top, jerk) {
                prop_assert!(table.pulses().is_finite() && !table.is_empty(), "{:?}", table);
                for frequency in [asked, start, top, 0.0] {
                    let found = table.frequency_after(table.pulses_to(frequency));
                    prop_assert!(found >= start * 0.999 && found <= top * 1.001, "{:?} {} {}", table, frequency, found);
                }
            }
        }

        #[test]
        fn sums_are_those_of_the_slices(table in tables()) {
            let mut sum = 0.0;
            for slice in table.iter() {
                prop_assert!((slice.pulses_before - sum).abs() <= 1e-9 * (1.0 + sum), "{} {}", slice.pulses_before, sum);
                prop_assert!(slice.duration_s > 0.0 && slice.frequency_hz >= table.start_hz());
                sum += slice.frequency_hz * slice.duration_s;
            }
            prop_assert!((table.pulses() - sum).abs() <= 1e-9 * (1.0 + sum));
        }

        #[test]
        fn the_whole_is_within_a_pulse_of_the_closed_form(table in tables()) {
            let exact = (table.start_hz() + table.top_hz()) * table.half_time_s();
            // The midpoint rule errs by j T^3 / 24 where the jerk changes its sign inside a slice.
            let slice = table.slice_s();
            let rule = table.jerk_hz_per_s2 * slice * slice * slice / 8.0;
            prop_assert!((table.pulses() - exact).abs() <= rule.max(1.0), "{} {}", table.pulses(), exact);
        }

        #[test]
        fn pulses_and_frequencies_are_inverse(table in tables(), share in 0.0f64..=1.0) {
            let frequency = table.start_hz() + (table.top_hz() - table.start_hz()) * share;
            let pulses = table.pulses_to(frequency);
            prop_assert!(pulses >= 0.0 && pulses <= table.pulses() * (1.0 + 1e-9));
            let found = table.frequency_after(pulses);
            prop_assert!((found - frequency).abs() <= 1e-5 * frequency, "{} {}", found, frequency);
            let part = table.pulses() * share;
            prop_assert!((table.pulses_to(table.frequency_after(part)) - part).abs() <= 1e-4 * (1.0 + part));
        }
    }
}
