//! G2 and G3: a circle as chords.

use ferrostep_planner::kinematics::{MAX_COORDINATE_10NM, UNITS_PER_MM, round_half_away};

use crate::error::CommandError;

/// Greatest distance of a chord from its arc, mm.
pub const CHORD_TOLERANCE_MM: f64 = 0.01;

/// Greatest difference between the radii at both ends, mm; with more, the line is an error. Slicers
/// round coordinates to 1 um, and old ones I and J to 10 um.
const RADIUS_TOLERANCE_MM: f64 = 0.1;

const MM: f64 = UNITS_PER_MM as f64;

/// An arc in the XY plane from the start to the end point, units of 10 nm.
#[derive(Clone, Copy, Debug)]
pub struct Arc {
    centre: [f64; 2],
    /// Start point seen from the centre, as a unit vector.
    start: [f64; 2],
    start_radius: f64,
    end_radius: f64,
    angle: f64,
    chords: u32,
    /// Range of the arc in X and in Y.
    reach: [[i64; 2]; 2],
}

fn length(vector: [f64; 2]) -> f64 {
    libm::sqrt(vector[0] * vector[0] + vector[1] * vector[1])
}

/// Cosine and sine of an angle of at most half a turn. Those of a library take any angle, which
/// costs 8 KiB of flash.
fn direction_at(angle: f64) -> [f64; 2] {
    // An eighth of the angle is so small that seven terms of its series are exact to the
    // last bit or two.
    let eighth = angle / 8.0;
    let square = eighth * eighth;
    let (mut cosine, mut sine) = (1.0, 1.0);
    for term in (1..=7).rev() {
        let even = f64::from(2 * term);
        cosine = 1.0 - cosine * square / (even * (even - 1.0));
        sine = 1.0 - sine * square / (even * (even + 1.0));
    }
    sine *= eighth;
    for _ in 0..3 {
        (cosine, sine) = (1.0 - 2.0 * sine * sine, 2.0 * sine * cosine);
    }
    [cosine, sine]
}

/// Returns true if a turn by an angle from a direction passes the direction of an axis, to its
/// upper (1) or lower side (-1).
fn passes(start: [f64; 2], angle: f64, axis: usize, side: f64) -> bool {
    let [x, y] = start;
    let (cross, dot) = if axis == 0 { (-y * side, x * side) } else { (x * side, y * side) };
    let mut between = libm::atan2(cross, dot);
    if angle > 0.0 && between < 0.0 {
        between += core::f64::consts::TAU;
    } else if angle < 0.0 && between > 0.0 {
        between -= core::f64::consts::TAU;
    }
    between.abs() <= angle.abs()
}

impl Arc {
    /// The arc around `centre`; equal start and end make a full circle.
    pub fn around(start: [i64; 2], end: [i64; 2], centre: [i64; 2], clockwise: bool) -> Result<Self, CommandError> {
        let from = [(start[0] - centre[0]) as f64, (start[1] - centre[1]) as f64];
        let to = [(end[0] - centre[0]) as f64, (end[1] - centre[1]) as f64];
        let (start_radius, end_radius) = (length(from), length(to));
        let apart = (start_radius - end_radius).abs();
        if start_radius < 1.0 || end_radius < 1.0 || apart > RADIUS_TOLERANCE_MM * MM {
            return Err(CommandError::ArcGeometry {
                start_radius_mm: start_radius / MM,
                end_radius_mm: end_radius / MM,
            });
        }
        let turn = core::f64::consts::TAU;
        // The chord is exact: the two ends of an arc of large radius differ in their
        // last digits only.
        let chord = [(end[0] - start[0]) as f64, (end[1] - start[1]) as f64];
        let cross = from[0] * chord[1] - from[1] * chord[0];
        let dot = from[0] * to[0] + from[1] * to[1];
        let mut angle = libm::atan2(cross, dot);
        if start == end {
            angle = if clockwise { -turn } else { turn };
        } else if clockwise && angle > 0.0 {
            angle -= turn;
        } else if !clockwise && angle < 0.0 {
            angle += turn;
        }
        // A chord over angle p is r (1 - cos(p/2)) away from its arc.
        let radius = start_radius.max(end_radius);
        let start_direction = [from[0] / start_radius, from[1] / start_radius];
        let reach = [0, 1].map(|axis| {
            let mut ends = [start[axis].min(end[axis]), start[axis].max(end[axis])];
            for (place, side) in ends.iter_mut().zip([-1.0, 1.0]) {
                if passes(start_direction, angle, axis, side) {
                    *place = round_half_away(centre[axis] as f64 + side * radius);
                }
            }
            ends
        });
        // All chords are checked before the first one is executed. Its points count, not its
        // centre, which may be kilometres away.
        if reach.as_flattened().iter().any(|place| place.unsigned_abs() > MAX_COORDINATE_10NM as u64) {
            return Err(CommandError::TooFar);
        }
        let cosine = (1.0 - CHORD_TOLERANCE_MM * MM / radius).max(0.0);
        let widest = 2.0 * libm::atan2(libm::sqrt(1.0 - cosine * cosine), cosine);
        let chords = (libm::ceil(angle.abs() / widest) as u32).max(1);
        Ok(Self {
            centre: [centre[0] as f64, centre[1] as f64],
            start: start_direction,
            start_radius,
            end_radius,
            angle,
            chords,
            reach,
        })
    }

    /// The arc of a given radius; a negative one asks for the longer way round.
    pub fn with_radius(start: [i64; 2], end: [i64; 2], radius: i64, clockwise: bool) -> Result<Self, CommandError> {
        let chord = [(end[0] - start[0]) as f64, (end[1] - start[1]) as f64];
        let distance = length(chord);
        let size = radius as f64;
        let height_squared = size * size - distance * distance / 4.0;
        // The rounding of coordinates may make half circles miss.
        if distance < 1.0 || height_squared < -(RADIUS_TOLERANCE_MM * MM * size.abs()) {
            return Err(CommandError::ArcRadius { radius_mm: size / MM, chord_mm: distance / MM });
        }
        let height = libm::sqrt(height_squared.max(0.0));
        let side = if clockwise == (radius > 0) { 1.0 } else { -1.0 };
        let across = [chord[1] / distance * height * side, -chord[0] / distance * height * side];
        let centre = [
            start[0] + round_half_away(chord[0] / 2.0 + across[0]),
            start[1] + round_half_away(chord[1] / 2.0 + across[1]),
        ];
        Self::around(start, end, centre, clockwise)
    }

    /// Number of chords, at least 1.
    pub fn chords(&self) -> u32 {
        self.chords
    }

    /// The centre seen from a point, mm.
    pub fn centre_from(&self, point: [i64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| (self.centre[axis] - point[axis] as f64) / MM)
    }

    /// Range of the arc in X and in Y, units of 10 nm.
    pub fn reach(&self) -> [[i64; 2]; 2] {
        self.reach
    }

    /// A length that no chord exceeds, units of 10 nm.
    pub fn longest_chord(&self) -> i64 {
        let radius = self.start_radius.max(self.end_radius);
        // The radius may change along the arc, and ends are rounded.
        let change = (self.end_radius - self.start_radius).abs();
        round_half_away(radius * self.angle.abs() / f64::from(self.chords) + change) + 2
    }

    /// The ends of all chords but the last, which ends where the arc ends.
    pub fn inner_points(&self) -> InnerPoints {
        InnerPoints {
            arc: *self,
            step: direction_at(self.angle / f64::from(self.chords)),
            direction: self.start,
            index: 0,
        }
    }
}

/// The ends of an arc's chords but the last.
#[derive(Clone, Debug)]
pub struct InnerPoints {
    arc: Arc,
    /// Cosine and sine of a chord's angle.
    step: [f64; 2],
    /// The last point seen from the centre, as a unit vector.
    direction: [f64; 2],
    index: u32,
}

impl Iterator for InnerPoints {
    type Item = [i64; 2];

    fn next(&mut self) -> Option<[i64; 2]> {
        let arc = &self.arc;
        if self.index + 1 >= arc.chords {
            return None;
        }
        self.index += 1;
        let ([cosine, sine], [x, y]) = (self.step, self.direction);
        self.direction = [x * cosine - y * sine, x * sine + y * cosine];
        let share = f64::from(self.index) / f64::from(arc.chords);
        let radius = arc.start_radius + (arc.end_radius - arc.start_radius) * share;
        Some([0, 1].map(|axis| round_half_away(arc.centre[axis] + self.direction[axis] * radius)))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn directions_equal_those_of_the_library() {
        for step in -10_000..=10_000 {
            let angle = f64::from(step) * 1e-4 * core::f64::consts::PI;
            let [cosine, sine] = direction_at(angle);
            assert!((cosine - angle.cos()).abs() < 4e-15 && (sine - angle.sin()).abs() < 4e-15, "{angle}");
        }
    }

    #[test]
    fn a_quarter_turn_anticlockwise() {
        let arc = Arc::around([1_000_000, 0], [0, 1_000_000], [0, 0], false).unwrap();
        let middle = arc.inner_points().nth(arc.chords() as usize / 2 - 1).unwrap();
        assert!(middle[0] > 0 && middle[1] > 0);
        let other = Arc::around([1_000_000, 0], [0, 1_000_000], [0, 0], true).unwrap();
        assert!(other.chords() > 2 * arc.chords());
    }

    #[test]
    fn radius_form_finds_the_same_circle() {
        // From (0,0) to (10,0) over a radius of 10: clockwise bulges upwards.
        for (clockwise, radius, sign) in [(true, 1_000_000, 1), (false, 1_000_000, -1)] {
            let arc = Arc::with_radius([0, 0], [1_000_000, 0], radius, clockwise).unwrap();
            let points: Vec<_> = arc.inner_points().collect();
            assert!(points.iter().all(|point| point[1] * sign > 0), "{clockwise}");
            let long = Arc::with_radius([0, 0], [1_000_000, 0], -radius, clockwise).unwrap();
            assert!(long.chords() > 3 * arc.chords());
        }
        assert!(Arc::with_radius([0, 0], [1_000_000, 0], 300_000, true).is_err());
        assert!(Arc::with_radius([0, 0], [0, 0], 300_000, true).is_err());
    }

    #[test]
    fn it_reaches_as_far_as_its_points() {
        let mm = |length: f64| round_half_away(length * MM);
        // Bulges to the right of its ends; the other way round to the left.
        let bulge =
            |clockwise| Arc::around([mm(195.0), mm(90.0)], [mm(195.0), mm(110.0)], [mm(195.0), mm(100.0)], clockwise);
        assert_eq!(bulge(false).unwrap().reach(), [[mm(195.0), mm(205.0)], [mm(90.0), mm(110.0)]]);
        assert_eq!(bulge(true).unwrap().reach(), [[mm(185.0), mm(195.0)], [mm(90.0), mm(110.0)]]);
        let circle = Arc::around([mm(5.0), 0], [mm(5.0), 0], [0, 0], true).unwrap();
        assert_eq!(circle.reach(), [[mm(-5.0), mm(5.0)]; 2]);
        // From 4.9 m to 5.1 m and back, and from 4.9 m a little on.
        let middle = [mm(4900.0), 0];
        assert_eq!(Arc::around([mm(4790.0), 0], [mm(4790.0), 0], middle, true).unwrap_err(), CommandError::TooFar);
        assert!(Arc::around([mm(4800.0), 0], [mm(4900.0), mm(100.0)], middle, true).is_ok());
    }

    /// The centre may be as far away as numbers go; a wall of 180 mm that is nearly straight
    /// keeps to its circle.
    #[test]
    fn large_radii_are_exact() {
        for radius_mm in [3_000.0, 9_999.0, 100_000.0, 10_000_000.0, 900_000_000.0] {
            for clockwise in [false, true] {
                let side = if clockwise { -1.0 } else { 1.0 };
                let centre = [10_000_000, round_half_away(side * radius_mm * MM)];
                // Symmetric about the axis, each end as far below it as the circle is there.
                let half: f64 = 90.0;
                let sagitta_mm = half * half / (radius_mm + (radius_mm * radius_mm - half * half).sqrt());
                let ends = [-half, half]
                    .map(|x| [10_000_000 + round_half_away(x * MM), round_half_away(side * sagitta_mm * MM)]);
                let arc = Arc::around(ends[0], ends[1], centre, clockwise).unwrap();
                let mut count = 0;
                let mut before = ends[0];
                for point in arc.inner_points().chain([ends[1]]) {
                    let x_mm = (point[0] - 10_000_000) as f64 / MM;
                    let y_mm = x_mm * x_mm / (radius_mm + (radius_mm * radius_mm - x_mm * x_mm).sqrt());
                    let off_mm = (point[1] as f64 / MM - side * y_mm).abs();
                    assert!(off_mm < 3e-5, "{radius_mm} {x_mm}: {off_mm}");
                    let chord = length([(point[0] - before[0]) as f64, (point[1] - before[1]) as f64]);
                    assert!(point[0] > before[0] && chord <= arc.longest_chord() as f64, "{radius_mm} {x_mm}");
                    (before, count) = (point, count + 1);
                }
                assert_eq!(count, arc.chords());
                let by_radius = Arc::with_radius(ends[0], ends[1], round_half_away(radius_mm * MM), clockwise).unwrap();
                assert_eq!(by_radius.chords(), arc.chords(), "{radius_mm}");
            }
        }
    }

    #[test]
    fn an_end_off_the_circle_is_refused() {
        assert!(Arc::around([1_000_000, 0], [0, 1_500_000], [0, 0], false).is_err());
        assert!(Arc::around([0, 0], [0, 0], [0, 0], false).is_err());
    }

    proptest! {
        #[test]
        fn chords_stay_within_tolerance(radius in 0.05f64..150.0, from in 0.0f64..6.2, sweep in 0.01f64..6.2, clockwise in any::<bool>()) {
            let point = |angle: f64| [round_half_away(radius * angle.cos() * MM), round_half_away(radius * angle.sin() * MM)];
            let (start, end) = (point(from), point(if clockwise { from - sweep } else { from + sweep }));
            prop_assume!(start != end);
            let arc = Arc::around(start, end, [0, 0], clockwise).unwrap();
            let mut before = start;
            let mut travelled = 0.0;
            for next in arc.inner_points().chain([end]) {
                let middle = [(before[0] + next[0]) as f64 / 2.0, (before[1] + next[1]) as f64 / 2.0];
                let sagitta = radius - length(middle) / MM;
                prop_assert!(sagitta.abs() <= CHORD_TOLERANCE_MM + 1e-4, "{}", sagitta);
                travelled += length([(next[0] - before[0]) as f64, (next[1] - before[1]) as f64]) / MM;
                before = next;
            }
            // The chords go the right way round.
            prop_assert!((travelled / (radius * sweep) - 1.0).abs() < 0.2 || travelled < 0.3);
        }
    }
}
