//! Draws a simulation: the motion around the largest error, and around the strongest stop.

use crate::measures::{Sample, Snapshots};
use ferrostep_svg::{escaped, page};
use std::fmt::Write;

/// Width of a panel, the margin to its left, and the gap to the next column, pixels.
const WIDTH: f64 = 460.0;
const LEFT: f64 = 70.0;
const GAP: f64 = 40.0;

/// Heights of the three panels of a column, pixels.
const HEIGHTS: [f64; 3] = [360.0, 150.0, 150.0];

/// Margin above the first panel, pixels.
const TOP: f64 = 60.0;

/// Margin between two panels, for labels, pixels.
const BETWEEN: f64 = 62.0;

/// Colours of the error classes from good to bad, distinguishable by colour-blind readers.
const COLOURS: [&str; 5] = ["#0072b2", "#56b4e9", "#e69f00", "#d55e00", "#7a0000"];

/// Names and colours of X and Y.
const AXES: [(&str, &str); 2] = [("X", "#0072b2"), ("Y", "#d55e00")];

/// Start and end of the time drawn around a stop, s.
const STOP_S: [f64; 2] = [-0.05, 0.2];

/// Rectangle on the page that shows a range of numbers.
struct Panel {
    x: f64,
    y: f64,
    height: f64,
    across: [f64; 2],
    up: [f64; 2],
}

impl Panel {
    fn place(&self, [across, up]: [f64; 2]) -> [f64; 2] {
        let part = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        [self.x + WIDTH * part(across, self.across), self.y + self.height * (1.0 - part(up, self.up))]
    }

    /// Draws the frame, with the numbers at both ends of each axis and the names of the axes.
    fn frame(&self, title: &str, across: &str, up: &str, out: &mut String) {
        let (x, y, bottom) = (self.x, self.y, self.y + self.height);
        let _ = writeln!(
            out,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{WIDTH}\" height=\"{}\" fill=\"none\" stroke=\"#8c959f\"/>\n\
             <text x=\"{x}\" y=\"{}\" font-weight=\"bold\">{}</text>\n\
             <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            self.height,
            y - 8.0,
            escaped(title),
            x + WIDTH / 2.0,
            bottom + 18.0,
            escaped(across)
        );
        for (value, anchor, place) in [(self.across[0], "start", x), (self.across[1], "end", x + WIDTH)] {
            let _ = writeln!(
                out,
                "<text x=\"{place}\" y=\"{}\" text-anchor=\"{anchor}\">{}</text>",
                bottom + 18.0,
                number(value)
            );
        }
        for (value, place) in [(self.up[0], bottom), (self.up[1], y + 12.0)] {
            let _ = writeln!(out, "<text x=\"{}\" y=\"{place}\" text-anchor=\"end\">{}</text>", x - 6.0, number(value));
        }
        let (label_x, label_y) = (x - 42.0, y + self.height / 2.0);
        let _ = writeln!(
            out,
            "<text x=\"{label_x}\" y=\"{label_y}\" text-anchor=\"middle\" transform=\"rotate(-90 {label_x} {label_y})\">{}</text>",
            escaped(up)
        );
    }

    /// Draws a line through points.
    fn line(&self, points: impl Iterator<Item = [f64; 2]>, colour: &str, width: f64, out: &mut String) {
        let mut path = String::new();
        for point in points {
            let [x, y] = self.place(point);
            let letter = if path.is_empty() { 'M' } else { 'L' };
            let _ = write!(path, "{letter}{x:.2} {y:.2}");
        }
        if !path.is_empty() {
            let _ = writeln!(
                out,
                "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"/>"
            );
        }
    }
}

/// Formats a number with as many digits as a label needs.
fn number(value: f64) -> String {
    if value.abs() >= 100.0 { format!("{value:.0}") } else { format!("{value:.2}") }
}

/// Returns the minimum and the maximum, with a margin around them.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return [0.0, 1.0];
    }
    let room = if high > low { 0.05 * (high - low) } else { 0.5 };
    [low - room, high + room]
}

/// Draws a picture with a column for each simulation: its name and its snapshots.
pub fn draw(title: &str, columns: &[(&str, &Snapshots)]) -> String {
    let mut content = String::new();
    let largest_um = columns
        .iter()
        .flat_map(|(_, snapshots)| &snapshots.around_largest_error().samples)
        .filter_map(|(_, error_um)| *error_um)
        .fold(1.0, f64::max);
    for (index, (name, snapshots)) in columns.iter().enumerate() {
        let x = LEFT + index as f64 * (WIDTH + LEFT + GAP);
        column(name, snapshots, x, largest_um, &mut content);
    }
    let width = columns.len().max(1) as f64 * (WIDTH + LEFT + GAP);
    let height = TOP + HEIGHTS.iter().sum::<f64>() + HEIGHTS.len() as f64 * BETWEEN;
    let _ = writeln!(content, "<text x=\"{LEFT}\" y=\"26\" font-size=\"16\">{}</text>", escaped(title));
    page(title, [width, height], 12, content)
}

fn column(name: &str, snapshots: &Snapshots, x: f64, largest_um: f64, out: &mut String) {
    let error = snapshots.around_largest_error();
    let y = [TOP, TOP + HEIGHTS[0] + BETWEEN, TOP + HEIGHTS[0] + HEIGHTS[1] + 2.0 * BETWEEN];
    let coordinate = |axis: usize| {
        range(error.samples.iter().flat_map(move |(sample, _)| [sample.command_mm[axis], sample.nozzle_mm[axis]]))
    };
    // A millimetre has the same length in both directions.
    let [mut across, mut up] = [coordinate(0), coordinate(1)];
    let scale = ((across[1] - across[0]) / WIDTH).max((up[1] - up[0]) / HEIGHTS[0]);
    for (range, length) in [(&mut across, WIDTH), (&mut up, HEIGHTS[0])] {
        let middle = 0.5 * (range[0] + range[1]);
        *range = [middle - 0.5 * scale * length, middle + 0.5 * scale * length];
    }
    let panel = Panel { x, y: y[0], height: HEIGHTS[0], across, up };
    panel.frame(
        &format!("{name}: path around the largest error (motors grey, nozzle by its error)"),
        "X, mm",
        "Y, mm",
        out,
    );
    panel.line(error.samples.iter().map(|(sample, _)| sample.command_mm), "#8c959f", 1.0, out);
    for pair in error.samples.windows(2) {
        if let [(from, Some(error_um)), (to, _)] = pair {
            let class = (error_um / largest_um * COLOURS.len() as f64) as usize;
            let colour = COLOURS[class.min(COLOURS.len() - 1)];
            panel.line([from.nozzle_mm, to.nozzle_mm].into_iter(), colour, 2.0, out);
        }
    }
    let since = |time_s: f64| move |sample: &Sample| (sample.time_s - time_s) * 1000.0;
    let ms = since(error.time_s);
    let panel = Panel {
        x,
        y: y[1],
        height: HEIGHTS[1],
        across: range(error.samples.iter().map(|(sample, _)| ms(sample))),
        up: [0.0, 1.05 * largest_um],
    };
    panel.frame(&format!("{name}: contour error"), "ms from the largest error", "um", out);
    for printing in error.samples.split(|(_, error_um)| error_um.is_none()) {
        let points = printing.iter().map(|(sample, error_um)| [ms(sample), error_um.unwrap_or(0.0)]);
        panel.line(points, COLOURS[0], 1.5, out);
    }
    let stop = snapshots.around_strongest_stop();
    let ms = since(stop.time_s);
    let samples: Vec<&Sample> = stop
        .samples
        .iter()
        .map(|(sample, _)| sample)
        .filter(|sample| (STOP_S[0]..=STOP_S[1]).contains(&(sample.time_s - stop.time_s)))
        .collect();
    let away_um = |sample: &Sample, axis: usize| (sample.nozzle_mm[axis] - sample.command_mm[axis]) * 1000.0;
    let panel = Panel {
        x,
        y: y[2],
        height: HEIGHTS[2],
        across: STOP_S.map(|time_s| time_s * 1000.0),
        up: range(samples.iter().flat_map(|sample| [away_um(sample, 0), away_um(sample, 1)])),
    };
    panel.frame(&format!("{name}: nozzle from the motors' place at the strongest stop"), "ms from the stop", "um", out);
    for (axis, (letter, colour)) in AXES.into_iter().enumerate() {
        panel.line(samples.iter().map(|sample| [ms(sample), away_um(sample, axis)]), colour, 1.5, out);
        let _ = writeln!(
            out,
            "<text x=\"{}\" y=\"{}\" fill=\"{colour}\">{letter}</text>",
            x + WIDTH - 30.0 + 14.0 * axis as f64,
            y[2] + 16.0
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_to_show_is_a_page_all_the_same() {
        let text = draw("a < b", &[("steps", &Snapshots::default()), ("other", &Snapshots::default())]);
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>") && text.contains("a &lt; b"));
        assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
    }
}
