//! The time of a job over the value of a key, drawn.

use std::fmt::Write;

use ferrostep_session::duration::hms;
use ferrostep_svg::{escaped, page};

use super::{Row, Swept};

/// The page, and the part of it that shows numbers, pixels.
const PAGE: [f64; 2] = [750.0, 400.0];
const LEFT: f64 = 110.0;
const RIGHT: f64 = 30.0;
const TOP: f64 = 60.0;
const BOTTOM: f64 = 60.0;

/// Colour of the line.
const COLOUR: &str = "#0072b2";

/// Scale from numbers to places, pixels.
struct Scale {
    from: [f64; 2],
    to: [f64; 2],
}

impl Scale {
    fn place(&self, value: f64) -> f64 {
        let [low, high] = self.from;
        let [start, end] = self.to;
        start + (end - start) * if high > low { (value - low) / (high - low) } else { 0.5 }
    }
}

/// A chart of a sweep: a point for each value that the job can be printed with, each value as far
/// from the next as the next from the one after it, and a dashed line where the profile is.
pub fn draw(swept: &Swept) -> String {
    let rows: Vec<(&Row, f64)> = swept.rows.iter().filter_map(|row| Some((row, row.print_time_s?))).collect();
    let times = || rows.iter().map(|(_, time_s)| *time_s).chain([swept.print_time_s]);
    let range = [times().fold(f64::MAX, f64::min), times().fold(0.0, f64::max)];
    let [width, height] = PAGE;
    let across = Scale { from: [0.0, rows.len().saturating_sub(1) as f64], to: [LEFT + 30.0, width - RIGHT - 30.0] };
    let up = Scale { from: range, to: [height - BOTTOM - 20.0, TOP + 20.0] };
    let mut content = String::new();
    let title = format!("{}, {}: time of the print", swept.file, swept.profile);
    let _ = writeln!(content, "<text x=\"20\" y=\"28\" font-size=\"15\">{}</text>", escaped(&title));
    let _ = writeln!(
        content,
        "<rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#8c959f\"/>",
        width - LEFT - RIGHT,
        height - TOP - BOTTOM
    );
    let own = up.place(swept.print_time_s);
    let _ = writeln!(
        content,
        "<path d=\"M{LEFT} {own:.1}H{}\" stroke=\"#8c959f\" stroke-dasharray=\"5 4\"/>\n\
         <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#57606a\">the profile, {}</text>",
        width - RIGHT,
        width - RIGHT - 6.0,
        own - 6.0,
        hms(swept.print_time_s)
    );
    let mut path = String::new();
    for (index, (row, time_s)) in rows.iter().enumerate() {
        let (x, y) = (across.place(index as f64), up.place(*time_s));
        let _ = write!(path, "{}{x:.1} {y:.1}", if index == 0 { 'M' } else { 'L' });
        let _ = writeln!(
            content,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{COLOUR}\"><title>{}: {}</title></circle>\n\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            row.value,
            hms(*time_s),
            height - BOTTOM + 20.0,
            row.value
        );
    }
    let _ = writeln!(content, "<path d=\"{path}\" fill=\"none\" stroke=\"{COLOUR}\" stroke-width=\"2\"/>");
    for time_s in range {
        let y = up.place(time_s) + 5.0;
        let _ = writeln!(content, "<text x=\"{}\" y=\"{y:.1}\" text-anchor=\"end\">{}</text>", LEFT - 8.0, hms(time_s));
    }
    let _ = writeln!(
        content,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
        LEFT + (width - LEFT - RIGHT) / 2.0,
        height - 18.0,
        escaped(&swept.label)
    );
    page(&title, PAGE, 13, content)
}
