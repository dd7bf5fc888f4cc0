//! A print that asks for more lines a second than any other: pieces of 0.05 mm at 300 mm/s.
//!
//! Rounds of a spiral, whose curvature changes slowly, and straight runs between them, all with extrusion, one of them
//! layered above the other. It is long, and made again whenever it is wanted.

use std::f64::consts::TAU;
use std::fmt::Write;

/// Length of a piece, mm.
pub const PIECE_MM: f64 = 0.05;

/// Feed that the file asks for, mm/s.
pub const FEED_MM_PER_S: f64 = 300.0;

/// Where the spiral has its centre, mm from the start, which is the place where the machine is switched on.
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

/// The file with about so many pieces: an absolute position of three decimals and filament of five in each line, as
/// slicers write them. A preamble lets it be printed cold, from where the machine stands.
pub fn stress_file(pieces: u32) -> String {
    let mut text = format!("M302 P1\nM83\nG92 E0\nG1 F{:.0}\n", FEED_MM_PER_S * 60.0);
    let mut at = [0.0, 0.0];
    let mut angle = 0.0;
    let mut written = 0;
    straight(&mut text, &mut at, on_spiral(angle), &mut written, pieces);
    while written < pieces {
        for _ in 0..CURVE_PIECES.min(pieces - written) {
            let (radius, growth) = spiral(angle);
            // The arc of an Archimedean spiral: ds = sqrt(r^2 + r'^2) d(angle).
            angle += PIECE_MM / (radius * radius + growth * growth).sqrt();
            line(&mut text, &mut at, on_spiral(angle));
            written += 1;
        }
        // On along the tangent, and the spiral again from where that leads.
        let [dx, dy] = direction(angle);
        let far = f64::from(STRAIGHT_PIECES) * PIECE_MM;
        let there = [at[0] + dx * far, at[1] + dy * far];
        let back = at;
        straight(&mut text, &mut at, there, &mut written, pieces);
        straight(&mut text, &mut at, back, &mut written, pieces);
        if angle > TURNS * TAU {
            angle -= TURNS * TAU;
            straight(&mut text, &mut at, on_spiral(angle), &mut written, pieces);
        }
    }
    text
}

/// The radius at an angle, and by how much it grows a radian, mm.
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

/// A straight run in pieces.
fn straight(text: &mut String, at: &mut [f64; 2], to: [f64; 2], written: &mut u32, most: u32) {
    let from = *at;
    let length = (to[0] - from[0]).hypot(to[1] - from[1]);
    let count = (length / PIECE_MM).round().max(1.0) as u32;
    for index in 1..=count.min(most - *written) {
        let share = f64::from(index) / f64::from(count);
        line(text, at, [from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share]);
        *written += 1;
    }
}

fn line(text: &mut String, at: &mut [f64; 2], to: [f64; 2]) {
    let filament = (to[0] - at[0]).hypot(to[1] - at[1]) * FILAMENT_PER_MM;
    *at = to;
    // Writing to a string does not fail.
    let _ = writeln!(text, "G1 X{:.3} Y{:.3} E{filament:.5}", to[0], to[1]);
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
            let points = points(&stress_file(pieces));
            assert_eq!(points.len(), pieces as usize);
            for pair in points.windows(2) {
                let length = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
                assert!((length - PIECE_MM).abs() < 0.002, "{pair:?}");
            }
            assert!(points.iter().flatten().all(|&coordinate| (-30.0..180.0).contains(&coordinate)));
        }
    }
}
