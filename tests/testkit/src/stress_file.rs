//! A print that needs more lines a second than any other: moves of 0.05 mm at 300 mm/s.
//!
//! Rounds of a spiral, whose curvature changes slowly, and straight runs between them, all with
//! extrusion. The file is long, and made anew for each use.

use std::f64::consts::TAU;
use std::fmt::Write;

/// Length of a piece, mm.
pub const PIECE_MM: f64 = 0.05;

/// Feed that the file asks for, mm/s.
pub const FEED_MM_PER_S: f64 = 300.0;

/// Centre of the spiral, mm from the start, where the machine is switched on.
const CENTRE_MM: [f64; 2] = [60.0, 60.0];

/// The spiral's radius at its start and what a turn adds, mm.
const RADIUS_MM: (f64, f64) = (20.0, 4.0);

/// Pieces of spiral between two straight runs, and of a straight run.
const CURVE_PIECES: u32 = 3_000;
const STRAIGHT_PIECES: u32 = 600;

/// Turns until the spiral starts again from its inside.
const TURNS: f64 = 7.0;

/// Filament of 1.75 mm for a line 0.4 mm wide and 0.2 mm high, mm for a mm of path.
const FILAMENT_PER_MM: f64 = 0.4 * 0.2 / (TAU / 8.0 * 1.75 * 1.75);

/// The file with this many moves: in each line an absolute position with this many decimals, and
/// filament with five. A preamble lets it be printed cold, from the machine's present place.
///
/// With three decimals, as slicers write them, rounding makes corners of a hundredth of a radian
/// between such pieces, and no planner that rounds corners within the pieces takes them at full
/// speed. With five decimals it does.
pub fn stress_file(pieces: u32, decimals: usize) -> String {
    let mut file = File { text: preamble(), at: [0.0; 2], left: pieces, decimals };
    file.print();
    file.text
}

fn preamble() -> String {
    format!("M302 P1\nM83\nG92 E0\nG1 F{:.0}\n", FEED_MM_PER_S * 60.0)
}

struct File {
    text: String,
    at: [f64; 2],
    left: u32,
    decimals: usize,
}

impl File {
    fn print(&mut self) {
        let mut angle = 0.0;
        self.straight(on_spiral(angle));
        while self.left > 0 {
            for _ in 0..CURVE_PIECES {
                let (radius, growth) = spiral(angle);
                // The arc of an Archimedean spiral: ds = sqrt(r^2 + r'^2) d(angle).
                angle += PIECE_MM / (radius * radius + growth * growth).sqrt();
                self.piece(on_spiral(angle));
            }
            // Along the tangent and back.
            let [dx, dy] = direction(angle);
            let far = f64::from(STRAIGHT_PIECES) * PIECE_MM;
            let here = self.at;
            self.straight([here[0] + dx * far, here[1] + dy * far]);
            self.straight(here);
            if angle > TURNS * TAU {
                angle -= TURNS * TAU;
                self.straight(on_spiral(angle));
            }
        }
    }

    /// A straight run in pieces.
    fn straight(&mut self, to: [f64; 2]) {
        let from = self.at;
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        let count = (length / PIECE_MM).round().max(1.0) as u32;
        for index in 1..=count {
            let share = f64::from(index) / f64::from(count);
            self.piece([from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share]);
        }
    }

    /// A piece, if there is one left.
    fn piece(&mut self, to: [f64; 2]) {
        let Some(left) = self.left.checked_sub(1) else { return };
        self.left = left;
        let filament = (to[0] - self.at[0]).hypot(to[1] - self.at[1]) * FILAMENT_PER_MM;
        self.at = to;
        let decimals = self.decimals;
        // Writing to a string does not fail.
        let _ = writeln!(self.text, "G1 X{:.decimals$} Y{:.decimals$} E{filament:.5}", to[0], to[1]);
    }
}

/// The radius at an angle, mm, and its growth a radian, mm.
fn spiral(angle: f64) -> (f64, f64) {
    let (first, a_turn) = RADIUS_MM;
    (first + a_turn * angle / TAU, a_turn / TAU)
}

fn on_spiral(angle: f64) -> [f64; 2] {
    let (radius, _) = spiral(angle);
    [CENTRE_MM[0] + radius * angle.cos(), CENTRE_MM[1] + radius * angle.sin()]
}

/// The spiral's direction at an angle, of length 1.
fn direction(angle: f64) -> [f64; 2] {
    let (radius, growth) = spiral(angle);
    let length = (radius * radius + growth * growth).sqrt();
    let (sine, cosine) = angle.sin_cos();
    [(growth * cosine - radius * sine) / length, (growth * sine + radius * cosine) / length]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// X and Y of the moves.
    fn points(text: &str) -> Vec<[f64; 2]> {
        let number = |word: &str| word[1..].parse::<f64>().unwrap();
        text.lines()
            .filter(|line| line.starts_with("G1 X"))
            .map(|line| {
                let words: Vec<&str> = line.split(' ').collect();
                assert!(number(words[3]) > 0.0, "{line}");
                [number(words[1]), number(words[2])]
            })
            .collect()
    }

    #[test]
    fn pieces_are_as_many_and_as_long_as_promised() {
        for pieces in [1, 1_000, 4_321, 60_000] {
            let points = points(&stress_file(pieces, 3));
            assert_eq!(points.len(), pieces as usize);
            for pair in points.windows(2) {
                let length = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
                assert!((length - PIECE_MM).abs() < 0.002, "{pair:?}");
            }
            assert!(points.iter().flatten().all(|&coordinate| (-30.0..180.0).contains(&coordinate)));
        }
    }
}
