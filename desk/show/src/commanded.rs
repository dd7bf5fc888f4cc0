//! The path that lines ask for, and how far from it the nozzle is: filters and corners take it off.

use std::collections::VecDeque;

/// A move that has been taken after the others.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlannedMove {
    /// End of X, Y and Z, machine coordinates, mm.
    pub target_mm: [f64; 3],
    /// Filament to push, mm.
    pub filament_mm: f64,
    /// Number of its line.
    pub line: u32,
    /// True if the line's move ends here.
    pub ends_move: bool,
    /// Moves slowed so far because the board could not keep up with them.
    pub slowed_moves: u64,
}

/// Path around the nozzle's expected place that is searched for its nearest point, mm; the second
/// is used if the first finds no near point.
const REACH_MM: f64 = 0.5;
const FAR_REACH_MM: f64 = 10.0;
/// Distance that the nozzle may go back on the path, mm, for the rounding of steps: a wipe goes
/// back over the line before. Distance from the path up to which a place counts as near, mm.
const BACK_MM: f64 = 0.03;
const NEAR_MM: f64 = 0.3;
/// Weight of a place's distance along the path from the expected place, added to its distance from
/// the nozzle: on a path that goes back over itself two places are equally near.
const PER_WAY: f64 = 0.1;
/// Lines of the last moves that are kept, more than a block has.
const MAX_TAKEN: usize = 256;

/// A block of several moves is no longer than this, mm: a longer move is slowed alone, and at once.
const SHARED_BLOCK_MM: f64 = 0.655_35;
/// Maximum number of lines that are kept until they are executed.
const MAX_LINES: usize = 1 << 16;

/// The ends of the moves that have been taken, as far as the nozzle has not passed them.
#[derive(Debug, Default)]
pub(crate) struct Commanded {
    ends_mm: VecDeque<[f64; 3]>,
    /// Distance along the path from the first end to the nozzle, mm.
    along_mm: f64,
    /// Length of the path before the first end, mm.
    before_mm: f64,
}

impl Commanded {
    /// A move has been taken; without others before it, it begins at `from_mm`. Its length, mm.
    pub fn take(&mut self, from_mm: [f64; 3], target_mm: [f64; 3]) -> f64 {
        let from_mm = match self.ends_mm.back() {
            Some(&last) => last,
            None => {
                self.ends_mm.push_back(from_mm);
                from_mm
            }
        };
        let length_mm = distance_mm(from_mm, target_mm);
        if length_mm > 0.0 {
            self.ends_mm.push_back(target_mm);
        }
        length_mm
    }

    /// The motion so far has been broken off.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Distance along all of the path to the nozzle, mm.
    pub fn along_mm(&self) -> f64 {
        self.before_mm + self.along_mm
    }

    /// Distance of the nozzle from the path, mm, after it has moved by `step_mm`; 0 where
    /// no path is known.
    pub fn deviation_mm(&mut self, place_mm: [f64; 3], step_mm: f64) -> f64 {
        let Some(near) = self.nearest(place_mm, step_mm, [BACK_MM, REACH_MM]) else { return 0.0 };
        let wide = if near.off_mm > NEAR_MM { self.nearest(place_mm, step_mm, [FAR_REACH_MM; 2]) } else { None };
        let wide = wide.filter(|wide| wide.off_mm < 0.5 * near.off_mm);
        let found = wide.unwrap_or(near);
        self.along_mm = wide.map_or(near.along_mm.max(self.along_mm), |wide| wide.along_mm);
        while let (Some(&first), Some(&second)) = (self.ends_mm.front(), self.ends_mm.get(1)) {
            let rest_mm = self.along_mm - distance_mm(first, second);
            if rest_mm < 2.0 * REACH_MM || self.ends_mm.len() < 3 {
                break;
            }
            self.ends_mm.pop_front();
            self.before_mm += self.along_mm - rest_mm;
            self.along_mm = rest_mm;
        }
        found.off_mm
    }

    /// Returns the nearest place within these distances before and after the nozzle's expected
    /// place.
    fn nearest(&self, place_mm: [f64; 3], step_mm: f64, [back_mm, ahead_mm]: [f64; 2]) -> Option<Near> {
        let expected_mm = self.along_mm + step_mm;
        let (low_mm, high_mm) = (self.along_mm - back_mm, expected_mm + step_mm + ahead_mm);
        let mut best: Option<(f64, Near)> = None;
        let mut start_mm = 0.0;
        for (&from, &to) in self.ends_mm.iter().zip(self.ends_mm.iter().skip(1)) {
            if start_mm > high_mm {
                break;
            }
            let length_mm = distance_mm(from, to);
            if start_mm + length_mm >= low_mm {
                let bounds_mm = [(low_mm - start_mm).max(0.0), (high_mm - start_mm).min(length_mm)];
                let (in_part_mm, off_mm) = nearest_in_part(place_mm, from, to, length_mm, bounds_mm);
                let along_mm = start_mm + in_part_mm;
                let rank = off_mm + PER_WAY * (along_mm - expected_mm).abs();
                if best.as_ref().is_none_or(|(least, _)| rank < *least) {
                    best = Some((rank, Near { along_mm, off_mm }));
                }
            }
            start_mm += length_mm;
        }
        best.map(|(_, near)| near)
    }
}

/// A place on the path.
#[derive(Clone, Copy, Debug)]
struct Near {
    along_mm: f64,
    /// Distance of the place from the nozzle.
    off_mm: f64,
}

/// The lines whose moves were slowed, as far as they have not been executed.
#[derive(Debug, Default)]
pub(crate) struct SlowedLines {
    /// Lines of the last moves.
    taken: VecDeque<u32>,
    waiting: VecDeque<u32>,
    slowed_moves: u64,
}

impl SlowedLines {
    /// A move has been taken. The planner does not say which moves it has slowed: they are the last
    /// ones before this one, or with this one if it is too long to share a block.
    pub fn take(&mut self, taken: &PlannedMove, length_mm: f64) {
        let slowed = taken.slowed_moves.saturating_sub(self.slowed_moves);
        self.slowed_moves = taken.slowed_moves;
        let is_alone = length_mm >= SHARED_BLOCK_MM;
        if is_alone {
            self.taken.push_back(taken.line);
        }
        let first = self.taken.len().saturating_sub(usize::try_from(slowed).unwrap_or(usize::MAX));
        for &line in self.taken.range(first..) {
            if self.waiting.back().is_none_or(|last| *last < line) && self.waiting.len() < MAX_LINES {
                self.waiting.push_back(line);
            }
        }
        if !is_alone {
            self.taken.push_back(taken.line);
        }
        while self.taken.len() > MAX_TAKEN {
            self.taken.pop_front();
        }
    }

    /// Returns true if the move of a line was slowed; lines must not go back.
    pub fn contains(&mut self, line: u32) -> bool {
        while self.waiting.pop_front_if(|waiting| *waiting < line).is_some() {}
        self.waiting.front() == Some(&line)
    }
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn distance_mm(a: [f64; 3], b: [f64; 3]) -> f64 {
    let off = minus(a, b);
    dot(off, off).sqrt()
}

/// The place of a straight part that is nearest, between bounds of its length; how far along it
/// lies, and how far it is off.
fn nearest_in_part(place: [f64; 3], from: [f64; 3], to: [f64; 3], length_mm: f64, bounds_mm: [f64; 2]) -> (f64, f64) {
    let (part, point) = (minus(to, from), minus(place, from));
    let [low_mm, high_mm] = bounds_mm;
    let along_mm = (dot(point, part) / length_mm).min(high_mm).max(low_mm);
    let off = minus(point, part.map(|side| side * along_mm / length_mm));
    (along_mm, dot(off, off).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_that_is_cut_is_off_the_path_by_its_distance() {
        let mut commanded = Commanded::default();
        assert_eq!(commanded.deviation_mm([5.0, 5.0, 0.0], 0.1), 0.0);
        commanded.take([0.0; 3], [10.0, 0.0, 0.0]);
        commanded.take([0.0; 3], [10.0, 10.0, 0.0]);
        commanded.take([0.0; 3], [0.0, 10.0, 0.0]);
        for (place, expected) in [
            ([4.0, 0.1, 0.0], 0.1),
            ([9.5, 0.2, 0.0], 0.2),
            ([9.8, 0.3, 0.0], 0.2),
            ([10.1, 4.0, 0.0], 0.1),
            ([9.0, 9.9, 0.3], 0.1_f64.hypot(0.3)),
        ] {
            let off = commanded.deviation_mm(place, 6.0);
            assert!((off - expected).abs() < 1e-9, "{place:?}: {off}, expected {expected}");
        }
        commanded.clear();
        assert_eq!(commanded.deviation_mm([5.0, 5.0, 0.0], 0.1), 0.0);
    }

    #[test]
    fn a_path_that_crosses_itself_is_followed() {
        let mut commanded = Commanded::default();
        // A zigzag of 1000 lines, 0.05 mm apart, back over itself.
        for line in 0..2000 {
            let there = if line < 1000 { line } else { 2000 - line };
            let y = 0.05 * f64::from(there / 2 * 2);
            commanded.take([0.0; 3], [if line % 2 == 0 { 20.0 } else { 0.0 }, y, 0.0]);
            for place in 1..=20 {
                let x = f64::from(place);
                let x = if line % 2 == 0 { x } else { 20.0 - x };
                let off = commanded.deviation_mm([x, y, 0.0], 1.0);
                assert!(off < 0.11, "line {line}, {x}: {off}");
            }
            assert!(commanded.ends_mm.len() < 10);
        }
    }

    #[test]
    fn sharp_turns_are_followed_in_small_steps() {
        let mut commanded = Commanded::default();
        let ends = [
            [91.5, 105.5],
            [93.561, 105.794],
            [92.781, 106.679],
            [93.218, 106.242],
            [93.091, 106.143],
            [92.861, 105.908],
            [92.539, 106.23],
            [92.861, 105.908],
            [93.091, 106.143],
            [93.218, 106.242],
        ];
        let ends = ends.map(|[x, y]| [x, y, 0.0]);
        for pair in ends.windows(2) {
            commanded.take(pair[0], pair[1]);
        }
        for pair in ends.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let steps = (distance_mm(from, to) / 0.02).ceil();
            for step in 1..=steps as u32 {
                let share = f64::from(step) / steps;
                // Motors stop on whole steps, here of 0.01 mm.
                let place = std::array::from_fn(|axis| {
                    ((from[axis] + (to[axis] - from[axis]) * share) * 100.0).round() / 100.0
                });
                let off = commanded.deviation_mm(place, 0.02);
                assert!(off < 0.02, "{place:?} from {from:?} to {to:?}: {off}");
            }
        }
    }

    #[test]
    fn the_lines_before_a_block_was_slowed_are_those_that_were_taken_last() {
        let mut slowed = SlowedLines::default();
        let mut take = |line, slowed_moves, length_mm| {
            slowed.take(&PlannedMove { line, slowed_moves, ..PlannedMove::default() }, length_mm);
        };
        take(1, 0, 0.1);
        take(2, 0, 0.1);
        take(3, 2, 0.1);
        take(4, 2, 5.0);
        take(5, 3, 5.0);
        assert_eq!([1, 2, 3, 4, 5, 6].map(|line| slowed.contains(line)), [true, true, false, false, true, false]);
    }
}
