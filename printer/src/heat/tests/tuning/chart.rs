//! Distances from the target, drawn: one row for each heater, two panels in a row.

use std::fmt::Write;
use std::format;
use std::string::String;
use std::vec::Vec;

use ferrostep_svg::{escaped, page};

/// Curves over the same seconds: the distance from the target at each second, degrees.
pub struct Panel {
    pub curves: Vec<(&'static str, Vec<f32>)>,
    /// Seconds that are marked, from and to.
    pub marked_s: Vec<[usize; 2]>,
}

/// A heater's two panels.
pub struct Row {
    pub name: &'static str,
    pub panels: [Panel; 2],
}

/// Parts of the chart beside the rows.
pub struct Chart {
    pub title: &'static str,
    pub heads: [&'static str; 2],
    /// Degrees from the target that are drawn, lowest and highest.
    pub ends: [f32; 2],
    /// Lines across.
    pub lines: &'static [f32],
}

const WIDTH: f64 = 760.0;
const ROW: f64 = 92.0;
const CURVE: f64 = 64.0;
const TOP: f64 = 82.0;
/// Left end and width of the two columns.
const COLUMNS: [[f64; 2]; 2] = [[46.0, 330.0], [410.0, 330.0]];
pub const GREY: &str = "#57606a";
pub const RUST: &str = "#b7410e";

/// The chart as an SVG file.
pub fn svg(chart: &Chart, rows: &[Row]) -> String {
    let height = TOP + rows.len() as f64 * ROW + 6.0;
    let title = chart.title;
    let mut out = format!("<text x=\"20\" y=\"26\" font-weight=\"bold\">{title}</text>\n");
    for (head, [left, _]) in chart.heads.into_iter().zip(COLUMNS) {
        let _ = writeln!(out, "<text x=\"{left}\" y=\"48\">{head}</text>");
    }
    for (index, row) in rows.iter().enumerate() {
        draw(&mut out, chart, row, TOP + index as f64 * ROW);
    }
    page(title, [WIDTH, height], 12, out)
}

fn draw(out: &mut String, chart: &Chart, row: &Row, top: f64) {
    let [low, high] = chart.ends;
    let down = |degrees: f32| top + CURVE * f64::from((high - degrees.clamp(low, high)) / (high - low));
    for (panel, [left, width]) in row.panels.iter().zip(COLUMNS).filter(|(panel, _)| !panel.curves.is_empty()) {
        let end = panel.curves.iter().map(|(_, curve)| curve.len()).max().unwrap_or(0).max(2) - 1;
        let across = |second: usize| left + width * second as f64 / end as f64;
        for [on, off] in &panel.marked_s {
            let (from, wide) = (across(*on), across(*off) - across(*on));
            let _ = writeln!(
                out,
                "<rect x=\"{from:.1}\" y=\"{top:.1}\" width=\"{wide:.1}\" height=\"{CURVE}\" fill=\"#8c959f\" fill-opacity=\"0.25\"/>"
            );
        }
        for degrees in chart.lines.iter().copied() {
            let (y, stroke) = (down(degrees), if degrees == 0.0 { "#8c959f" } else { "#d8dee4" });
            let _ = writeln!(
                out,
                "<path d=\"M{left} {y:.1}h{width}\" stroke=\"{stroke}\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"10\">{degrees}</text>",
                left - 5.0,
                y + 3.5
            );
        }
        for (colour, curve) in &panel.curves {
            let mut path = String::new();
            for (second, degrees) in curve.iter().enumerate() {
                let letter = if second == 0 { 'M' } else { 'L' };
                let _ = write!(path, "{letter}{:.1} {:.1}", across(second), down(*degrees));
            }
            let _ = writeln!(out, "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.4\"/>");
        }
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"10\">{end} s</text>",
            left + width,
            top + CURVE + 12.0
        );
    }
    let _ = writeln!(out, "<text x=\"{}\" y=\"{:.1}\">{}</text>", COLUMNS[0][0], top - 5.0, escaped(row.name));
}
