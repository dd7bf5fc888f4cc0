//! The same lines with motors that turn evenly between their steps.
//!
//! A rotor is heavy and does not stand still between two steps of a fast motor. In this view, each
//! motor's position rises linearly from the middle of one step to the middle of the next. This is
//! the other extreme of judging a line, and the one in which the paper's dual-rate lines are
//! straight.

use crate::plane::LineEvent;

/// Distance from the ideal line, pulses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distance {
    /// Largest distance, pulses.
    pub largest: f64,
    /// Mean over the line's duration, pulses.
    pub mean: f64,
}

/// Positions of a motor over time: shares of the line's duration, and steps.
struct Turning {
    corners: Vec<(f64, f64)>,
}

impl Turning {
    fn new(events: &[LineEvent], motor: usize) -> Self {
        let mut corners = vec![(0.0, 0.0)];
        let mut place = 0.0;
        for event in events {
            let step = f64::from(event.steps[motor]);
            if step != 0.0 {
                corners.push((event.share, place + step / 2.0));
                place += step;
            }
        }
        corners.push((1.0, place));
        Self { corners }
    }

    /// Position at a time.
    fn at(&self, share: f64) -> f64 {
        let after = self.corners.partition_point(|corner| corner.0 < share).clamp(1, self.corners.len() - 1);
        let ((from, start), (to, end)) = (self.corners[after - 1], self.corners[after]);
        if to > from { start + (end - start) * (share - from) / (to - from) } else { end }
    }
}

/// Distance from the ideal line to (x, y) pulses of a line made of A and B's steps.
pub fn distance(x: i64, y: i64, events: &[LineEvent]) -> Distance {
    let [first, second] = [0, 1].map(|motor| Turning::new(events, motor));
    let length = (x as f64).hypot(y as f64);
    let signed = |share: f64| {
        let (a, b) = (first.at(share), second.at(share));
        let (here_x, here_y) = ((a + b) / 2.0, (a - b) / 2.0);
        (x as f64 * here_y - y as f64 * here_x) / length
    };
    let mut distance = Distance::default();
    let (mut since, mut before) = (0.0, 0.0f64);
    for share in events.iter().map(|event| event.share).chain([1.0]) {
        let off = signed(share);
        distance.largest = distance.largest.max(off.abs());
        // Straight between the corners; two triangles if it crosses the line.
        let size = before.abs() + off.abs();
        let area = if before * off < 0.0 { (before * before + off * off) / (2.0 * size) } else { size / 2.0 };
        distance.mean += area * (share - since);
        (since, before) = (share, off);
    }
    distance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_few_pulses_by_hand() {
        // Both motors at their own rates: straight.
        let even = [(1.0 / 6.0, [1, 0]), (0.5, [1, 1]), (5.0 / 6.0, [1, 0])];
        let events = even.map(|(share, steps)| LineEvent { share, steps });
        let straight = distance(2, 1, &events);
        assert!(straight.largest < 1e-12 && straight.mean < 1e-12);
        // B a sixth of the time early: at 1/3 it is at 1/2 instead of 1/3, and 1/6 too far;
        // x - y is. sqrt(5) is the length, and (x y' - y x') = (2 (a - b) - (a + b)) / 2 =
        // (a - 3 b) / 2 = -1/4.
        let uneven = [(1.0 / 6.0, [1, 0]), (1.0 / 3.0, [0, 1]), (0.5, [1, 0]), (5.0 / 6.0, [1, 0])];
        let events = uneven.map(|(share, steps)| LineEvent { share, steps });
        let off = distance(2, 1, &events);
        assert!((off.largest - 0.25 / 5f64.sqrt()).abs() < 1e-12, "{off:?}");
        // A triangle over the whole time.
        assert!((off.mean - 0.125 / 5f64.sqrt()).abs() < 1e-12, "{off:?}");
    }
}
