//! Instructions of a step interrupt as bars.

use std::fmt::Write;

use ferrostep_svg::{escaped, page};

/// A bar.
pub struct Bar {
    /// Label of the bar.
    pub label: String,
    /// Length of the bar.
    pub instructions: f64,
    /// True if Ferrostep executes it, false for another firmware.
    pub own: bool,
}

/// Bars under a heading.
pub struct Group {
    /// The heading.
    pub heading: String,
    /// The bars, from above.
    pub bars: Vec<Bar>,
}

const WIDTH: f64 = 720.0;
/// Left end of the bars; the labels end before it.
const LEFT: f64 = 250.0;
/// The longest bar ends here; its number follows.
const RIGHT: f64 = WIDTH - 70.0;
const ROW: f64 = 28.0;
const BAR: f64 = 18.0;
const HEADING: f64 = 38.0;
const TOP: f64 = 8.0;

const OWN_COLOUR: &str = "#b7410e";
const OTHER_COLOUR: &str = "#8c959f";

/// The chart as an SVG file.
pub fn svg(title: &str, groups: &[Group]) -> String {
    let bars = || groups.iter().flat_map(|group| &group.bars);
    let longest = bars().fold(1.0, |longest: f64, bar| longest.max(bar.instructions));
    let height = 2.0 * TOP + groups.len() as f64 * HEADING + bars().count() as f64 * ROW;
    let mut out = String::new();
    // Writing to a string does not fail.
    let mut y = TOP;
    for group in groups {
        let _ = writeln!(
            out,
            "<text x=\"20\" y=\"{}\" font-weight=\"bold\">{}</text>",
            y + HEADING - 14.0,
            escaped(&group.heading)
        );
        y += HEADING;
        for Bar { label, instructions, own } in &group.bars {
            let length = instructions / longest * (RIGHT - LEFT);
            let middle = y + BAR / 2.0 + 5.0;
            let colour = if *own { OWN_COLOUR } else { OTHER_COLOUR };
            let _ = writeln!(
                out,
                "<text x=\"{}\" y=\"{middle}\" text-anchor=\"end\">{}</text>\
                 <rect x=\"{LEFT}\" y=\"{y}\" width=\"{length:.1}\" height=\"{BAR}\" rx=\"2\" fill=\"{colour}\"/>\
                 <text x=\"{:.1}\" y=\"{middle}\">{instructions}</text>",
                LEFT - 10.0,
                escaped(label),
                LEFT + length + 8.0,
            );
            y += ROW;
        }
    }
    page(title, [WIDTH, height], 14, out)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_as_long_as_their_numbers() {
        let bar = |instructions, own| Bar { label: "a < b".to_owned(), instructions, own };
        let svg = svg("t", &[Group { heading: "h".to_owned(), bars: vec![bar(50.0, false), bar(25.0, true)] }]);
        let full = RIGHT - LEFT;
        assert!(svg.contains(&format!("width=\"{full:.1}\" height=\"18\" rx=\"2\" fill=\"{OTHER_COLOUR}\"")), "{svg}");
        let half = full / 2.0;
        assert!(svg.contains(&format!("width=\"{half:.1}\" height=\"18\" rx=\"2\" fill=\"{OWN_COLOUR}\"")), "{svg}");
        assert!(svg.contains("a &lt; b") && !svg.contains("a < b"));
    }
}
