//! An autotune and what its gains do, drawn: one row for each heater.

use std::fmt::Write;
use std::format;
use std::string::String;
use std::vec::Vec;

use ferrostep_svg::{escaped, page};

/// A heater's two curves: the distance from the target at each second, degrees.
pub struct Row {
    pub name: &'static str,
    pub tuning: Vec<f32>,
    pub tuned: Vec<f32>,
    /// When the fan goes on and off, s.
    pub fan_s: Option<[usize; 2]>,
}

const WIDTH: f64 = 760.0;
const ROW: f64 = 92.0;
const CURVE: f64 = 64.0;
const TOP: f64 = 82.0;
/// Left end and width of the two columns.
const COLUMNS: [[f64; 2]; 2] = [[46.0, 330.0], [410.0, 330.0]];
/// Degrees from the target that are drawn.
const LOW: f32 = -12.0;
const HIGH: f32 = 8.0;
const COLOURS: [&str; 2] = ["#57606a", "#b7410e"];

/// The chart as an SVG file.
pub fn svg(rows: &[Row]) -> String {
    let height = TOP + rows.len() as f64 * ROW + 6.0;
    let title = "Degrees from the target: while it is tuned, and with the gains found";
    let mut out = format!("<text x=\"20\" y=\"26\" font-weight=\"bold\">{title}</text>\n");
    for (head, [left, _]) in ["M303", "heating up, fan on and off (grey)"].into_iter().zip(COLUMNS) {
        let _ = writeln!(out, "<text x=\"{left}\" y=\"48\">{head}</text>");
    }
    for (index, row) in rows.iter().enumerate() {
        draw(&mut out, row, TOP + index as f64 * ROW);
    }
    page(title, [WIDTH, height], 12, out)
}

fn draw(out: &mut String, row: &Row, top: f64) {
    let down = |degrees: f32| top + CURVE * f64::from((HIGH - degrees.clamp(LOW, HIGH)) / (HIGH - LOW));
    let curves = [&row.tuning, &row.tuned];
    for (column, ((curve, colour), [left, width])) in curves.into_iter().zip(COLOURS).zip(COLUMNS).enumerate() {
        let end = curve.len().max(2) - 1;
        let across = |second: usize| left + width * second as f64 / end as f64;
        if let (1, Some([on, off])) = (column, row.fan_s) {
            let (from, wide) = (across(on), across(off) - across(on));
            let _ = writeln!(
                out,
                "<rect x=\"{from:.1}\" y=\"{top:.1}\" width=\"{wide:.1}\" height=\"{CURVE}\" fill=\"#8c959f\" fill-opacity=\"0.25\"/>"
            );
        }
        for degrees in [-10.0, -5.0, 0.0, 5.0] {
            let (y, stroke) = (down(degrees), if degrees == 0.0 { "#8c959f" } else { "#d8dee4" });
            let _ = writeln!(
                out,
                "<path d=\"M{left} {y:.1}h{width}\" stroke=\"{stroke}\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"10\">{degrees}</text>",
                left - 5.0,
                y + 3.5
            );
        }
        let mut path = String::new();
        for (second, degrees) in curve.iter().enumerate() {
            let letter = if second == 0 { 'M' } else { 'L' };
            let _ = write!(path, "{letter}{:.1} {:.1}", across(second), down(*degrees));
        }
        let _ = writeln!(
            out,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.4\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" font-size=\"10\">{end} s</text>",
            left + width,
            top + CURVE + 12.0
        );
    }
    let _ = writeln!(out, "<text x=\"{}\" y=\"{:.1}\">{}</text>", COLUMNS[0][0], top - 5.0, escaped(row.name));
}
