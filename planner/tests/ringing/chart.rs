//! Chart of the vibration that shapers leave over the frame's frequency, as small multiples: a
//! panel for each kind, all on the same axes.

use std::fmt::Write;

use ferrostep_svg::{escaped, page};

/// Vibration that one kind of shaper leaves.
pub struct Panel {
    /// Name of the kind.
    pub name: &'static str,
    /// The frame's frequency as a part of the shaper's, what the steps leave, what the formula
    /// leaves; both as parts of the unshaped vibration.
    pub points: Vec<[f64; 3]>,
}

/// The frame's frequencies across, as parts of the shaper's.
pub const ACROSS: [f64; 2] = [0.5, 2.0];

/// Range of the unshaped vibration; a shaper leaves no more than all of it.
const UP: [f64; 2] = [0.0, 1.0];

const COLUMNS: usize = 4;
const WIDTH: f64 = 170.0;
const HEIGHT: f64 = 110.0;
const LEFT: f64 = 56.0;
const TOP: f64 = 70.0;
/// Room between panels, pixels.
const GAP: [f64; 2] = [22.0, 52.0];

const STEPS_COLOUR: &str = "#b7410e";
const FORMULA_COLOUR: &str = "#9cc3e6";
const GRID_COLOUR: &str = "#d8dee4";
const NOTE_COLOUR: &str = "#57606a";

/// The chart as an SVG file.
pub fn svg(title: &str, note: &str, panels: &[Panel]) -> String {
    let mut out = String::new();
    // Writing to a string does not fail.
    let _ = writeln!(
        out,
        "<text x=\"20\" y=\"26\" font-weight=\"bold\">{}</text>\n<text x=\"20\" y=\"44\" font-size=\"11\" fill=\"{NOTE_COLOUR}\">{}</text>",
        escaped(title),
        escaped(note)
    );
    for (index, panel) in panels.iter().enumerate() {
        let (column, row) = (index % COLUMNS, index / COLUMNS);
        let x = LEFT + column as f64 * (WIDTH + GAP[0]);
        let y = TOP + row as f64 * (HEIGHT + GAP[1]);
        draw(&mut out, panel, [x, y], column == 0);
    }
    let rows = panels.len().div_ceil(COLUMNS);
    let width = LEFT + COLUMNS as f64 * (WIDTH + GAP[0]);
    page(title, [width, TOP + rows as f64 * (HEIGHT + GAP[1])], 13, out)
}

fn part(value: f64, [low, high]: [f64; 2]) -> f64 {
    (value - low) / (high - low)
}

fn draw(out: &mut String, panel: &Panel, [left, top]: [f64; 2], is_first: bool) {
    let x = |value: f64| left + WIDTH * part(value, ACROSS);
    let y = |value: f64| top + HEIGHT * (1.0 - part(value, UP));
    for value in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let y = y(value);
        let _ = writeln!(out, "<path d=\"M{left:.1} {y:.1}h{WIDTH}\" stroke=\"{GRID_COLOUR}\"/>");
        if is_first {
            let _ = writeln!(
                out,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"10\" fill=\"{NOTE_COLOUR}\">{:.0} %</text>",
                left - 6.0,
                y + 3.5,
                100.0 * value
            );
        }
    }
    for value in [0.5, 0.8, 1.0, 1.2, 1.5, 2.0] {
        let x = x(value);
        let _ = writeln!(
            out,
            "<path d=\"M{x:.1} {top:.1}v{HEIGHT}\" stroke=\"{GRID_COLOUR}\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\" \
             font-size=\"10\" fill=\"{NOTE_COLOUR}\">{value}</text>",
            top + HEIGHT + 14.0
        );
    }
    let _ = writeln!(out, "<text x=\"{left:.1}\" y=\"{:.1}\" font-weight=\"bold\">{}</text>", top - 6.0, panel.name);
    for (which, colour, width) in [(2, FORMULA_COLOUR, 4.0), (1, STEPS_COLOUR, 1.2)] {
        out.push_str("<path d=\"");
        for (index, point) in panel.points.iter().enumerate() {
            let letter = if index == 0 { 'M' } else { 'L' };
            let _ = write!(out, "{letter}{:.1} {:.1}", x(point[0]), y(point[which]));
        }
        let _ =
            writeln!(out, "\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"/>");
    }
}
