//! Feed against time as small multiples: one panel for each print, all on the same axes.

use std::fmt::Write;

use ferrostep_svg::{escaped, page};

/// One print.
pub struct Panel {
    /// Title.
    pub label: String,
    /// Result.
    pub note: String,
    /// Feed, mm/s, at each ms.
    pub feeds: Vec<f64>,
}

/// The axes that all panels share.
pub struct Axes {
    /// End of the time axis, ms.
    pub end_ms: usize,
    /// End of the feed axis, mm/s.
    pub most_mm_per_s: f64,
    /// Distances of the grid's lines: ms and mm/s.
    pub grid: (usize, f64),
}

const WIDTH: f64 = 760.0;
/// The curves' place in a panel.
const LEFT: f64 = 190.0;
const RIGHT: f64 = WIDTH - 24.0;
const PANEL: f64 = 84.0;
const CURVE: f64 = 62.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = 44.0;

const CURVE_COLOUR: &str = "#b7410e";
const GRID_COLOUR: &str = "#d8dee4";
const NOTE_COLOUR: &str = "#57606a";

/// The chart as an SVG file.
pub fn svg(title: &str, axes: &Axes, panels: &[Panel]) -> String {
    let height = TOP + panels.len() as f64 * PANEL + BOTTOM;
    let mut out = String::new();
    // Writing to a string does not fail.
    let _ = writeln!(out, "<text x=\"20\" y=\"26\" font-weight=\"bold\">{}</text>", escaped(title));
    for (index, panel) in panels.iter().enumerate() {
        draw(&mut out, axes, panel, TOP + index as f64 * PANEL);
    }
    let bottom = TOP + panels.len() as f64 * PANEL;
    for ms in (0..=axes.end_ms).step_by(axes.grid.0.max(1)) {
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"11\">{}</text>",
            place_ms(axes, ms),
            bottom + 6.0,
            ms as f64 / 1_000.0
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" font-size=\"11\" fill=\"{NOTE_COLOUR}\">time, s; the upright \
         axes are feeds, mm/s</text>",
        (LEFT + RIGHT) / 2.0,
        bottom + 26.0
    );
    page(title, [WIDTH, height], 13, out)
}

fn place_ms(axes: &Axes, ms: usize) -> f64 {
    LEFT + ms as f64 / axes.end_ms.max(1) as f64 * (RIGHT - LEFT)
}

fn draw(out: &mut String, axes: &Axes, panel: &Panel, top: f64) {
    let height_of = |feed: f64| top + CURVE * (1.0 - feed / axes.most_mm_per_s);
    let steps = (axes.most_mm_per_s / axes.grid.1) as usize;
    for feed in (0..=steps).map(|step| step as f64 * axes.grid.1) {
        let y = height_of(feed);
        let _ = writeln!(
            out,
            "<path d=\"M{LEFT} {y:.1}H{RIGHT}\" stroke=\"{GRID_COLOUR}\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" \
             font-size=\"10\" fill=\"{NOTE_COLOUR}\">{feed}</text>",
            LEFT - 6.0,
            y + 3.5
        );
    }
    for ms in (0..=axes.end_ms).step_by(axes.grid.0.max(1)) {
        let x = place_ms(axes, ms);
        let _ = writeln!(out, "<path d=\"M{x:.1} {top}v{CURVE}\" stroke=\"{GRID_COLOUR}\"/>");
    }
    let _ =
        writeln!(out, "<text x=\"20\" y=\"{:.1}\" font-weight=\"bold\">{}</text>", top + 20.0, escaped(&panel.label));
    for (line, note) in panel.note.lines().enumerate() {
        let y = top + 37.0 + line as f64 * 15.0;
        let _ = writeln!(
            out,
            "<text x=\"20\" y=\"{y:.1}\" font-size=\"11\" fill=\"{NOTE_COLOUR}\">{}</text>",
            escaped(note)
        );
    }
    out.push_str("<path d=\"");
    let feeds = &panel.feeds[..panel.feeds.len().min(axes.end_ms + 1)];
    for (ms, feed) in feeds.iter().enumerate() {
        // A point between two equal ones adds nothing.
        if ms > 0 && feeds[ms - 1] == *feed && feeds.get(ms + 1) == Some(feed) {
            continue;
        }
        let command = if ms == 0 { 'M' } else { 'L' };
        let _ = write!(out, "{command}{:.1} {:.1}", place_ms(axes, ms), height_of(*feed));
    }
    let _ = writeln!(out, "\" fill=\"none\" stroke=\"{CURVE_COLOUR}\" stroke-width=\"1.2\"/>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_lie_where_the_axes_say() {
        let panel = |feeds| Panel { label: "a < b".to_owned(), note: "one\ntwo".to_owned(), feeds };
        let axes = Axes { end_ms: 2, most_mm_per_s: 300.0, grid: (1, 100.0) };
        let svg = svg("t", &axes, &[panel(vec![0.0, 150.0, 300.0, 99.0]), panel(vec![300.0])]);
        let (low, middle, high) = (TOP + CURVE, TOP + CURVE / 2.0, TOP);
        let half = (LEFT + RIGHT) / 2.0;
        let curve = format!("M{LEFT:.1} {low:.1}L{half:.1} {middle:.1}L{RIGHT:.1} {high:.1}\"");
        assert!(svg.contains(&curve), "{svg}");
        assert!(svg.contains(&format!("M{LEFT:.1} {:.1}\"", TOP + PANEL)));
        assert!(svg.contains("a &lt; b") && !svg.contains("a < b"));
    }
}
