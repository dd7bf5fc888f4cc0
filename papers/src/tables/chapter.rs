//! A chapter: tables and figures as data.

use serde::{Serialize, Serializer};

/// A paper's tables and figures, made anew.
#[derive(Clone, Debug, Serialize)]
pub struct Chapter {
    /// Short name: `wu` ...
    pub name: &'static str,
    /// The paper's title and place.
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
    /// Content, and the paper's table that it belongs to.
    pub title: String,
    /// Heads of its columns, units included.
    pub columns: Vec<&'static str>,
    /// Rows, each as long as the head.
    pub rows: Vec<Vec<Cell>>,
    /// Note for the reader; may be empty.
    pub note: String,
}

/// A place in a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Cell {
    /// Words.
    Text(String),
    /// A whole number.
    Count(i64),
    /// A number, and how many of its decimals are shown.
    #[serde(serialize_with = "bare_number")]
    Number(f64, usize),
    /// An empty cell.
    Empty,
}

/// A number without its decimals: readers of JSON round for themselves.
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
    /// Name of its file, without the ending.
    pub name: &'static str,
    /// Content, and the paper's figure that it belongs to.
    pub title: String,
    /// Quantity of the horizontal axis, with its unit.
    pub x_label: &'static str,
    /// Quantity of the vertical axis, with its unit.
    pub y_label: &'static str,
    /// True if a unit is equally long in both directions.
    pub equal_scales: bool,
    /// Curves to draw.
    pub curves: Vec<Curve>,
}

/// Points that belong together.
#[derive(Clone, Debug, Serialize)]
pub struct Curve {
    /// Name in the legend.
    pub name: String,
    /// Style of drawing.
    pub style: Style,
    /// Points in order.
    pub points: Vec<(f64, f64)>,
}

/// Style in which points are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Style {
    /// Joined.
    Line,
    /// Joined by dashes.
    Dashed,
    /// Each alone.
    Points,
    /// Each, and joined.
    LineAndPoints,
}
