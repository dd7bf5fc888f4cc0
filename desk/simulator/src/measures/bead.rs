//! Measures misplaced material at corners and at the ends of lines.
//!
//! At each instant the nozzle should extrude its speed times the bead's cross-section. The
//! difference is assigned to the place on the path where the nozzle is, and with it to the nearest
//! corner or end, if that is near enough.

use crate::path::PathSegment;
use serde::Serialize;
use std::collections::VecDeque;

/// Maximum distance at which a difference is assigned to a corner or an end, mm.
const REACH_MM: f64 = 5.0;

/// Length of path over which differences are summed, mm.
const BIN_MM: f64 = 0.1;

/// Distance after which a place counts as passed for good, mm; twice the reach.
const PASSED_MM: f64 = 2.0 * REACH_MM;

/// Cosine of 30 degrees; a sharper turn is a corner.
const CORNER_COSINE: f64 = 0.866_025_403_784_438_6;

/// Maximum pause within a line, s; a longer one ends the line.
const PAUSE_S: f64 = 1e-6;

/// Misplaced material; differences in both directions, too much and too little, count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct BeadReport {
    /// Misplaced volume within 5 mm of path from a corner, mean of all corners, mm^3.
    pub corner_volume_mm3: f64,
    /// Number of corners: turns by more than 30 degrees between two printed moves without a stop.
    pub corners: u64,
    /// Misplaced volume within 5 mm of path from a start or an end of a line, mean of all, mm^3;
    /// includes filament that comes out on travels.
    pub end_volume_mm3: f64,
    /// Number of starts and ends of lines, and of stops within them.
    pub ends: u64,
    /// Sum of the misplaced volumes elsewhere, mm^3.
    pub elsewhere_volume_mm3: f64,
    /// Filament that came out while no line was printed, on travels and at stops for filament,
    /// mm^3; also counted above.
    pub oozed_volume_mm3: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Feature {
    Corner,
    End,
}

#[derive(Debug, Default)]
pub(super) struct Bead {
    features: VecDeque<(f64, Feature)>,
    before: Option<PathSegment>,
    /// Sums of absolute differences; the first is for bin number `first_bin`.
    bins: VecDeque<f64>,
    first_bin: usize,
    place_mm: f64,
    report: BeadReport,
    corner_mm3: f64,
    end_mm3: f64,
}

impl Bead {
    /// Continues the path with a segment that begins at this length.
    pub(super) fn push_segment(&mut self, segment: &PathSegment, place_mm: f64) {
        let before = self.before.replace(*segment);
        let printed = before.filter(PathSegment::is_printing);
        let feature = match (printed, segment.is_printing()) {
            (None, false) => return,
            (None, true) | (Some(_), false) => Feature::End,
            (Some(before), true) => {
                let ([x0, y0], [x1, y1]) = (before.direction(), segment.direction());
                if segment.start_s - before.end_s > PAUSE_S {
                    Feature::End
                } else if x0 * x1 + y0 * y1 < CORNER_COSINE {
                    Feature::Corner
                } else {
                    return;
                }
            }
        };
        match feature {
            Feature::Corner => self.report.corners += 1,
            Feature::End => self.report.ends += 1,
        }
        self.features.push_back((place_mm, feature));
    }

    /// Adds a difference at a place on the path; without a place, at the nozzle's last one. The
    /// path is known up to `known_mm`.
    pub(super) fn add(&mut self, place_mm: Option<f64>, difference_mm3: f64, known_mm: f64) {
        self.place_mm = place_mm.unwrap_or(self.place_mm);
        let settled_mm = (self.place_mm - PASSED_MM).min(known_mm - REACH_MM);
        self.settle(settled_mm);
        if self.bins.is_empty() {
            // Places that the nozzle has jumped over have no differences.
            self.first_bin = self.first_bin.max((settled_mm / BIN_MM) as usize);
        }
        let bin = (self.place_mm / BIN_MM) as usize;
        // If the place was passed long ago, its bin is settled and the first unsettled one takes
        // the difference.
        let index = bin.saturating_sub(self.first_bin);
        while self.bins.len() <= index {
            self.bins.push_back(0.0);
        }
        self.bins[index] += difference_mm3.abs();
    }

    /// Counts a volume that came out while no line was printed.
    pub(super) fn ooze(&mut self, out_mm3: f64) {
        self.report.oozed_volume_mm3 += out_mm3;
    }

    fn settle(&mut self, until_mm: f64) {
        while !self.bins.is_empty() && (self.first_bin + 1) as f64 * BIN_MM < until_mm {
            let Some(sum_mm3) = self.bins.pop_front() else { return };
            let middle_mm = (self.first_bin as f64 + 0.5) * BIN_MM;
            self.first_bin += 1;
            while self.features.front().is_some_and(|(place_mm, _)| *place_mm < middle_mm - REACH_MM) {
                self.features.pop_front();
            }
            let nearest = self
                .features
                .iter()
                .take_while(|(place_mm, _)| *place_mm <= middle_mm + REACH_MM)
                .min_by(|one, other| (one.0 - middle_mm).abs().total_cmp(&(other.0 - middle_mm).abs()));
            match nearest {
                Some((_, Feature::Corner)) => self.corner_mm3 += sum_mm3,
                Some((_, Feature::End)) => self.end_mm3 += sum_mm3,
                None => self.report.elsewhere_volume_mm3 += sum_mm3,
            }
        }
    }

    pub(super) fn finish(mut self) -> BeadReport {
        if let Some(true) = self.before.map(|before| before.is_printing()) {
            // The path ends with a printed line.
            self.report.ends += 1;
            self.features.push_back((self.place_mm, Feature::End));
        }
        self.settle(f64::INFINITY);
        let mean = |sum: f64, count: u64| if count == 0 { 0.0 } else { sum / count as f64 };
        BeadReport {
            corner_volume_mm3: mean(self.corner_mm3, self.report.corners),
            end_volume_mm3: mean(self.end_mm3, self.report.ends),
            ..self.report
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_along_the_path_takes_no_memory() {
        let mut bead = Bead::default();
        bead.add(Some(3.0), 0.5, 1e6);
        bead.add(Some(9e5), 0.25, 1e6);
        assert!(bead.bins.capacity() < 1000, "{}", bead.bins.capacity());
        bead.add(Some(9e5 + 20.0), 0.125, 1e6);
        assert_eq!(bead.finish().elsewhere_volume_mm3, 0.875);
    }
}
