//! G2 and G3 as chords.

use std::f64::consts::TAU;

/// Maximum distance between a chord and its arc: 0.01 mm, as the firmware promises. Longer
/// chords would change the motion time by a percent or two, because the arc that fits a junction
/// grows with them.
const CHORD_TOLERANCE_10NM: f64 = 1000.0;

/// Maximum number of chords, more than any printable arc needs: it bounds the memory that a hostile
/// line can demand.
const CHORDS_MAX: f64 = 100_000.0;

/// An arc in the X-Y plane, coordinates in units of 10 nm.
#[derive(Clone, Copy, Debug)]
pub struct Arc {
    /// The start.
    pub start: [f64; 2],
    /// The end.
    pub end: [f64; 2],
    /// G2.
    pub clockwise: bool,
}

impl Arc {
    /// The centre that I and J (offsets from the start) give; `None` for no offset at all.
    pub fn centre_from_offset(&self, offset: [f64; 2]) -> Option<[f64; 2]> {
        (offset != [0.0, 0.0]).then(|| [self.start[0] + offset[0], self.start[1] + offset[1]])
    }

    /// The centre that R gives: on the right of the chord for a short clockwise arc, mirrored for
    /// the other direction, and once more for a negative radius (the long way round). A radius
    /// shorter than half the chord places the centre in the chord's middle. `None` if start and end
    /// are the same point.
    pub fn centre_from_radius(&self, radius: f64) -> Option<[f64; 2]> {
        let half = [(self.end[0] - self.start[0]) / 2.0, (self.end[1] - self.start[1]) / 2.0];
        let half_length = half[0].hypot(half[1]);
        if half_length == 0.0 || radius == 0.0 {
            return None;
        }
        let height = ((radius.abs() - half_length) * (radius.abs() + half_length)).max(0.0).sqrt();
        let side = if self.clockwise != (radius < 0.0) { -1.0 } else { 1.0 };
        let along = side * height / half_length;
        Some([self.start[0] + half[0] - half[1] * along, self.start[1] + half[1] + half[0] * along])
    }

    /// The points strictly between start and end, each with the part (0 to 1) of the arc
    /// covered up to it.
    pub fn points_between(&self, centre: [f64; 2]) -> Vec<([f64; 2], f64)> {
        let from = [self.start[0] - centre[0], self.start[1] - centre[1]];
        let to = [self.end[0] - centre[0], self.end[1] - centre[1]];
        let (radius, end_radius) = (from[0].hypot(from[1]), to[0].hypot(to[1]));
        let mut angle = (from[0] * to[1] - from[1] * to[0]).atan2(from[0] * to[0] + from[1] * to[1]).rem_euclid(TAU);
        if self.clockwise {
            angle -= TAU;
        }
        if self.start == self.end {
            angle = if self.clockwise { -TAU } else { TAU };
        }
        // A chord of angle p is r*(1 - cos(p/2)) off the arc, most where the radius is larger.
        let widest = 2.0 * (1.0 - CHORD_TOLERANCE_10NM / radius.max(end_radius)).max(0.0).acos();
        let chords = (angle.abs() / widest).ceil().clamp(1.0, CHORDS_MAX);
        let mut points = Vec::new();
        for index in 1..chords as u32 {
            let part = f64::from(index) / chords;
            let (sine, cosine) = (angle * part).sin_cos();
            // Slicers round, so the end is seldom exactly on the circle: the radius changes
            // evenly towards it.
            let scale = 1.0 + (end_radius / radius - 1.0) * part;
            let x = centre[0] + (from[0] * cosine - from[1] * sine) * scale;
            let y = centre[1] + (from[0] * sine + from[1] * cosine) * scale;
            points.push(([x, y], part));
        }
        points
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const MM: f64 = 100_000.0;

    fn length(arc: &Arc, centre: [f64; 2]) -> f64 {
        let mut before = arc.start;
        let mut sum = 0.0;
        for point in arc.points_between(centre).into_iter().map(|(point, _)| point).chain([arc.end]) {
            sum += (point[0] - before[0]).hypot(point[1] - before[1]);
            before = point;
        }
        sum
    }

    #[test]
    fn quarter_and_three_quarters() {
        let arc = Arc { start: [10.0 * MM, 0.0], end: [0.0, 10.0 * MM], clockwise: false };
        let centre = arc.centre_from_offset([-10.0 * MM, 0.0]).unwrap();
        assert!((length(&arc, centre) / MM - 10.0 * TAU / 4.0).abs() < 0.01);
        let other = Arc { clockwise: true, ..arc };
        assert!((length(&other, centre) / MM - 10.0 * TAU * 0.75).abs() < 0.02);
    }

    #[test]
    fn radius_form_finds_the_same_centres() {
        let arc = Arc { start: [10.0 * MM, 0.0], end: [0.0, 10.0 * MM], clockwise: false };
        let near = |point: [f64; 2], wanted: [f64; 2]| {
            assert!((point[0] - wanted[0]).abs() < 1.0 && (point[1] - wanted[1]).abs() < 1.0, "{point:?}");
        };
        near(arc.centre_from_radius(10.0 * MM).unwrap(), [0.0, 0.0]);
        near(arc.centre_from_radius(-10.0 * MM).unwrap(), [10.0 * MM, 10.0 * MM]);
        let clockwise = Arc { clockwise: true, ..arc };
        near(clockwise.centre_from_radius(10.0 * MM).unwrap(), [10.0 * MM, 10.0 * MM]);
        assert!(Arc { end: arc.start, ..arc }.centre_from_radius(MM).is_none());
    }

    #[test]
    fn same_start_and_end_is_a_full_circle() {
        let arc = Arc { start: [0.0, 0.0], end: [0.0, 0.0], clockwise: true };
        let centre = arc.centre_from_offset([5.0 * MM, 0.0]).unwrap();
        assert!((length(&arc, centre) / MM - 5.0 * TAU).abs() < 0.03);
    }
}
