//! Programmed path, with the times at which the plan passes it.

use std::collections::VecDeque;

/// Straight part of the programmed path in X and Y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathSegment {
    /// Time at which the plan, without any filter, begins the segment, s.
    pub start_s: f64,
    /// Time at which the plan ends the segment, s.
    pub end_s: f64,
    /// Start point, mm.
    pub from_mm: [f64; 2],
    /// End point, mm.
    pub to_mm: [f64; 2],
    /// Cross-section of the material along the segment, mm^2 (that is, mm^3/mm); 0 on a travel.
    pub bead_mm2: f64,
}

impl PathSegment {
    /// Returns the length, mm.
    pub fn length_mm(&self) -> f64 {
        (self.to_mm[0] - self.from_mm[0]).hypot(self.to_mm[1] - self.from_mm[1])
    }

    /// Returns true if material is laid along the segment.
    pub fn is_printing(&self) -> bool {
        self.bead_mm2 > 0.0
    }

    /// Returns the direction as a unit vector; zero for a point.
    pub fn direction(&self) -> [f64; 2] {
        let length_mm = self.length_mm();
        if length_mm == 0.0 {
            return [0.0; 2];
        }
        [(self.to_mm[0] - self.from_mm[0]) / length_mm, (self.to_mm[1] - self.from_mm[1]) / length_mm]
    }

    /// Returns the distance of a point from the segment, mm, and the position of the nearest point
    /// along the segment, mm.
    pub fn nearest(&self, [x, y]: [f64; 2]) -> (f64, f64) {
        let ([x0, y0], [x1, y1]) = (self.from_mm, self.to_mm);
        let (dx, dy) = (x1 - x0, y1 - y0);
        let square = dx * dx + dy * dy;
        let part = if square > 0.0 { (((x - x0) * dx + (y - y0) * dy) / square).clamp(0.0, 1.0) } else { 0.0 };
        ((x - x0 - part * dx).hypot(y - y0 - part * dy), part * square.sqrt())
    }
}

/// Window of the path around the present time.
#[derive(Clone, Debug, Default)]
pub struct PathWindow {
    segments: VecDeque<(PathSegment, f64)>,
    length_mm: f64,
    known_until_s: f64,
}

impl PathWindow {
    /// Appends a segment; segments must come in order of time.
    pub fn push(&mut self, segment: PathSegment) {
        self.segments.push_back((segment, self.length_mm));
        self.length_mm += segment.length_mm();
        self.known_until_s = self.known_until_s.max(segment.end_s);
    }

    /// Returns the time up to which the path is known, s.
    pub const fn known_until_s(&self) -> f64 {
        self.known_until_s
    }

    /// Marks the path as complete up to this time, s: the motors were at rest, or moved only Z or
    /// the extruder.
    pub fn nothing_until(&mut self, time_s: f64) {
        self.known_until_s = self.known_until_s.max(time_s);
    }

    /// Returns the length of all segments so far, mm.
    pub const fn length_mm(&self) -> f64 {
        self.length_mm
    }

    /// Drops the segments that ended before a time, except the last one.
    pub fn forget_before(&mut self, time_s: f64) {
        while self.segments.len() > 1 && self.segments.front().is_some_and(|(segment, _)| segment.end_s < time_s) {
            self.segments.pop_front();
        }
    }

    /// Returns the segment that the plan passes at a time.
    pub fn at(&self, time_s: f64) -> Option<&PathSegment> {
        let index = self.segments.partition_point(|(segment, _)| segment.end_s <= time_s);
        self.segments.get(index).map(|(segment, _)| segment).filter(|segment| segment.start_s <= time_s)
    }

    /// Returns the nearest of the segments that the plan passes between two times: its distance,
    /// the position along the whole path, and the segment.
    pub fn nearest(&self, point_mm: [f64; 2], [from_s, to_s]: [f64; 2]) -> Option<(f64, f64, &PathSegment)> {
        let mut best: Option<(f64, f64, &PathSegment)> = None;
        let first = self.segments.partition_point(|(segment, _)| segment.end_s < from_s);
        for (segment, place_mm) in self.segments.range(first..) {
            if segment.start_s > to_s {
                break;
            }
            let (distance_mm, along_mm) = segment.nearest(point_mm);
            if best.is_none_or(|(least_mm, ..)| distance_mm < least_mm) {
                best = Some((distance_mm, place_mm + along_mm, segment));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn segment(start_s: f64, from_mm: [f64; 2], to_mm: [f64; 2]) -> PathSegment {
        PathSegment { start_s, end_s: start_s + 1.0, from_mm, to_mm, bead_mm2: 0.09 }
    }

    #[test]
    fn distances_are_to_the_segment_and_not_to_its_line() {
        let one = segment(0.0, [0.0, 0.0], [4.0, 3.0]);
        assert_eq!(one.length_mm(), 5.0);
        assert_eq!(one.direction(), [0.8, 0.6]);
        let (distance, along) = one.nearest([-3.0, -4.0]);
        assert_eq!((distance, along), (5.0, 0.0));
        let (distance, along) = one.nearest([0.8 - 0.6, 0.6 + 0.8]);
        assert!((distance - 1.0).abs() < 1e-12 && (along - 1.0).abs() < 1e-12);
        assert_eq!(segment(0.0, [1.0, 1.0], [1.0, 1.0]).nearest([1.0, 3.0]), (2.0, 0.0));
    }

    #[test]
    fn only_the_window_is_searched() {
        let mut path = PathWindow::default();
        path.push(segment(0.0, [0.0, 0.0], [10.0, 0.0]));
        path.push(segment(1.0, [10.0, 0.0], [10.0, 1.0]));
        path.push(segment(2.0, [10.0, 1.0], [0.0, 1.0]));
        assert_eq!(path.length_mm(), 21.0);
        let near =
            |from_s, to_s| path.nearest([5.0, 0.6], [from_s, to_s]).map(|(distance, place, _)| (distance, place));
        assert_eq!(near(0.2, 0.4), Some((0.6, 5.0)));
        let (distance, place) = near(0.2, 2.5).unwrap();
        assert!((distance - 0.4).abs() < 1e-12 && (place - 16.0).abs() < 1e-12);
        assert_eq!(near(5.0, 6.0), None);
        assert_eq!(path.at(1.5).unwrap().to_mm, [10.0, 1.0]);
        assert!(path.at(3.5).is_none());
        path.forget_before(2.5);
        assert_eq!(path.nearest([5.0, 0.0], [0.0, 9.0]).unwrap().1, 16.0);
    }
}
