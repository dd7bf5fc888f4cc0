//! A chapter: tables and figures as data.

use serde::{Serialize, Serializer};

/// Reproduced tables and figures of a paper.
#[derive(Clone, Debug, Serialize)]
pub struct Chapter {
    /// Short name: `wu` ...
    pub name: &'static str,
    /// Title and publication of the paper.
    pub source: &'static str,
    /// Tables of the chapter.
    pub tables: Vec<Table>,
    /// Figures of the chapter.
    pub figures: Vec<Figure>,
}

/// A table.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// Key in JSON, `lower_case`.
    pub key: &'static str,
    /// Content, and the corresponding table of the paper.
    pub title: String,
    /// Column headings, including units.
    pub columns: Vec<&'static str>,
    /// Rows, each as long as the heading.
    pub rows: Vec<Vec<Cell>>,
    /// Note for the reader; may be empty.
    pub note: String,
}

/// A cell of a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Cell {
    /// A text.
    Text(String),
    /// A whole number.
    Count(i64),
    /// A number, and the number of decimals shown.
    #[serde(serialize_with = "bare_number")]
    Number(f64, usize),
    /// An empty cell.
    Empty,
}

/// Serialises a number unrounded: readers of JSON round for themselves.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "as the caller has it")]
fn bare_number<S: Serializer>(number: &f64, _decimals: &usize, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(*number)
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

/// A figure.
#[derive(Clone, Debug, Serialize)]
pub struct Figure {
    /// File name without the extension.
    pub name: &'static str,
    /// Content, and the corresponding figure of the paper.
    pub title: String,
    /// Quantity of the horizontal axis, with its unit.
    pub x_label: &'static str,
    /// Quantity of the vertical axis, with its unit.
    pub y_label: &'static str,
    /// True if a unit has the same length in both directions.
    pub equal_scales: bool,
    /// Curves to draw.
    pub curves: Vec<Curve>,
}

/// A series of points.
#[derive(Clone, Debug, Serialize)]
pub struct Curve {
    /// Name in the legend.
    pub name: String,
    /// Style of drawing.
    pub style: Style,
    /// Points in order.
    pub points: Vec<(f64, f64)>,
}

/// Drawing style of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Style {
    /// Points joined by lines.
    Line,
    /// Points joined by dashes.
    Dashed,
    /// Separate points.
    Points,
    /// Marked points joined by lines.
    LineAndPoints,
}
