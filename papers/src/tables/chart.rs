//! Figures as SVG.

use std::fmt;
use std::path::{Path, PathBuf};

use plotters::prelude::*;

use super::chapter::{Curve, Figure, Style};

/// Width of a picture, pixels. The library draws at whole pixels, which would show at a smaller
/// size.
const WIDTH: u32 = 1920;

/// Height of a picture with independent scales, pixels.
const HEIGHT: u32 = 1120;

/// Space for labels beside and below the axes, pixels.
const MARGINS: [u32; 2] = [168, 220];

/// Height of a line of the legend, pixels.
const LEGEND_LINE: u32 = 44;

/// Colours that people with colour vision deficiency can tell apart (Okabe and Ito).
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
];

/// Error for a picture that could not be written.
#[derive(Debug)]
pub struct DrawError {
    path: PathBuf,
    reason: String,
}

impl DrawError {
    pub(super) fn new(path: &Path, reason: impl fmt::Display) -> Self {
        Self { path: path.to_path_buf(), reason: reason.to_string() }
    }
}

impl fmt::Display for DrawError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}: cannot be written: {}", self.path.display(), self.reason)
    }
}

impl std::error::Error for DrawError {}

/// Minimum and maximum of some numbers, with a small margin.
fn range(numbers: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = numbers.fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)));
    let room = if high > low { 0.04 * (high - low) } else { 1.0 };
    (low - room, high + room)
}

/// Height at which a unit has the same length in both directions.
fn equal_height(x: (f64, f64), y: (f64, f64)) -> u32 {
    let [beside, below] = MARGINS;
    let pixels_per_unit = f64::from(WIDTH - beside) / (x.1 - x.0);
    // Keeps a very flat figure visible.
    (((y.1 - y.0) * pixels_per_unit) as u32).clamp(240, 2 * WIDTH) + below
}

/// Draws a figure into a folder; returns the path.
pub(super) fn draw(figure: &Figure, folder: &Path) -> Result<PathBuf, DrawError> {
    let path = folder.join(figure.name).with_extension("svg");
    let svg = svg(figure).map_err(|reason| DrawError::new(&path, reason))?;
    std::fs::write(&path, svg).map_err(|error| DrawError::new(&path, error))?;
    Ok(path)
}

/// SVG text of the picture.
fn svg(figure: &Figure) -> Result<String, String> {
    let points = || figure.curves.iter().flat_map(|curve| curve.points.iter());
    let (x, y) = (range(points().map(|point| point.0)), range(points().map(|point| point.1)));
    let height = if figure.equal_scales { equal_height(x, y) } else { HEIGHT };
    // The legend is above the plot.
    let legend = LEGEND_LINE * figure.curves.len() as u32 + LEGEND_LINE;
    let [_, below] = MARGINS;
    let y = (y.0, y.1 + (y.1 - y.0) * f64::from(legend) / f64::from(height - below));
    let height = height + legend;
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (WIDTH, height)).into_drawing_area();
        fill(&area, figure, x, y).map_err(|error| error.to_string())?;
    }
    Ok(text)
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn fill(area: &Area<'_>, figure: &Figure, x: (f64, f64), y: (f64, f64)) -> Result<(), Box<dyn std::error::Error>> {
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(area)
        .caption(&figure.title, ("sans-serif", 34))
        .margin(24)
        .x_label_area_size(84)
        .y_label_area_size(116)
        .build_cartesian_2d(x.0..x.1, y.0..y.1)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc(figure.x_label)
        .y_desc(figure.y_label)
        .label_style(("sans-serif", 26))
        .draw()?;
    for (curve, colour) in figure.curves.iter().zip(COLOURS.iter().cycle()) {
        let Curve { name, style, points } = curve;
        let line = colour.stroke_width(3);
        let drawn = match style {
            Style::Line | Style::LineAndPoints => chart.draw_series(LineSeries::new(points.iter().copied(), line))?,
            Style::Dashed => chart.draw_series(DashedLineSeries::new(points.iter().copied(), 12, 8, line))?,
            Style::Points => chart.draw_series(points.iter().map(|&point| Circle::new(point, 6, colour.filled())))?,
        };
        drawn.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 36, y)], line));
        if *style == Style::LineAndPoints {
            chart.draw_series(points.iter().map(|&point| Circle::new(point, 6, colour.filled())))?;
        }
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .legend_area_size(44)
        .label_font(("sans-serif", 26))
        .position(SeriesLabelPosition::UpperLeft)
        .draw()?;
    area.present()?;
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_has_every_curve_and_its_name() {
        let curve = |name: &str, style| Curve { name: name.to_owned(), style, points: vec![(0.0, 0.0), (30.0, 10.0)] };
        let figure = Figure {
            name: "lines",
            title: "Lines <of> all kinds".to_owned(),
            x_label: "x",
            y_label: "y",
            equal_scales: true,
            curves: vec![
                curve("one", Style::Line),
                curve("two", Style::Dashed),
                curve("three", Style::Points),
                curve("four", Style::LineAndPoints),
            ],
        };
        let text = svg(&figure).unwrap();
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"));
        for name in ["one", "two", "three", "four", "Lines &lt;of&gt; all kinds"] {
            assert!(text.contains(name), "{name}");
        }
        assert_eq!(text.matches("<circle").count(), 4);
    }
}
