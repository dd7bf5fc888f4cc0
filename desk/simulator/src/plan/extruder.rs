//! Applies pressure advance and smoothing to the filament's law, at equal times.

use crate::law::{ShapedCursor, ShapedLaw};
use crate::measures::SAMPLE_S;
use crate::shapers::Shaper;
use std::collections::VecDeque;

/// Filters of the filament, in the order in which they apply.
#[derive(Clone, Debug)]
pub struct ExtruderFilter {
    /// Pressure advance, s.
    pub advance_s: f64,
    /// Shaper of the filament; the shaper of X and Y if the filament is shaped along with them.
    pub shaper: Shaper,
    /// Lengths of moving averages, s, rounded to multiples of two samples; two of the same length
    /// make a triangle.
    pub boxes_s: Vec<f64>,
}

impl Default for ExtruderFilter {
    /// Returns a filter that changes nothing.
    fn default() -> Self {
        Self { advance_s: 0.0, shaper: Shaper::identity(), boxes_s: Vec::new() }
    }
}

impl ExtruderFilter {
    /// Returns Klipper's filter: pressure advance smoothed by a triangle of this length, which
    /// applies to the base motion and the advance alike.
    pub fn klipper(advance_s: f64, smooth_time_s: f64) -> Self {
        let boxes_s = if smooth_time_s > 0.0 { vec![0.5 * smooth_time_s; 2] } else { Vec::new() };
        Self { advance_s, boxes_s, ..Self::default() }
    }
}

/// Moving average.
struct Average {
    values: VecDeque<f64>,
    /// Number of values that are averaged.
    length: usize,
    sum: f64,
    /// True if the first and the last value count half, for values at points; false for means over
    /// cells.
    of_points: bool,
}

impl Average {
    fn new(length: usize, of_points: bool) -> Self {
        Self { values: VecDeque::with_capacity(length), length, sum: 0.0, of_points }
    }

    /// Adds a value and returns the average, once there are enough values.
    fn push(&mut self, value: f64) -> Option<f64> {
        self.values.push_back(value);
        self.sum += value;
        if self.values.len() < self.length {
            return None;
        }
        let first = self.values.pop_front()?;
        let average = if self.of_points {
            (self.sum - 0.5 * (first + value)) / (self.length - 1) as f64
        } else {
            self.sum / self.length as f64
        };
        self.sum -= first;
        Some(average)
    }
}

/// Positions of the filament, sample by sample.
pub(crate) struct ExtruderSamples<'a> {
    cursor: ShapedCursor<'a>,
    /// Time up to which the law has been read, s.
    read_until_s: f64,
    averages: Vec<Average>,
}

impl<'a> ExtruderSamples<'a> {
    /// Samples a shaped law with these moving averages applied; the first sample will be at
    /// `first_s`.
    pub(crate) fn new(shaped: ShapedLaw<'a>, boxes_s: &[f64], first_s: f64) -> Self {
        // Half lengths, so that an average is centred at a sample.
        let halves: Vec<usize> = boxes_s
            .iter()
            .map(|length_s| (0.5 * length_s / SAMPLE_S).round() as usize)
            .filter(|half| *half > 0)
            .collect();
        let lead: usize = halves.iter().sum();
        // The first average takes exact means between samples; the others average its results,
        // which are at samples.
        let averages = halves.iter().enumerate().map(|(index, half)| {
            let of_points = index > 0;
            Average::new(2 * half + usize::from(of_points), of_points)
        });
        Self {
            averages: averages.collect(),
            cursor: ShapedCursor::new(shaped),
            read_until_s: first_s - lead as f64 * SAMPLE_S,
        }
    }

    pub(crate) fn next_mm(&mut self) -> f64 {
        if self.averages.is_empty() {
            let position_mm = self.cursor.at(self.read_until_s).position_mm;
            self.read_until_s += SAMPLE_S;
            return position_mm;
        }
        loop {
            let mut value = Some(self.mean_of_next_cell());
            for average in &mut self.averages {
                value = value.and_then(|value| average.push(value));
            }
            if let Some(value) = value {
                return value;
            }
        }
    }

    /// Returns the mean position over the next sample interval.
    fn mean_of_next_cell(&mut self) -> f64 {
        let start_s = self.read_until_s;
        let end_s = start_s + SAMPLE_S;
        let (mut time_s, mut sum) = (start_s, 0.0);
        while time_s < end_s {
            let until_s = self.cursor.next_breakpoint_s(time_s).min(end_s);
            let part_s = until_s - time_s;
            let middle = self.cursor.at(time_s + 0.5 * part_s);
            // The mean of a parabola is its value in the middle plus a twenty-fourth of its second
            // derivative times the interval squared.
            sum += part_s * (middle.position_mm + middle.acceleration_mm_per_s2 * part_s * part_s / 24.0);
            time_s = until_s;
        }
        self.read_until_s = end_s;
        sum / SAMPLE_S
    }
}
