//! The papers' tables and figures, made anew: what `ferrostep papers` prints.
//!
//! A chapter is data: what it says as text, as JSON and as pictures is decided in one place for all of them.

pub mod corexy;
pub mod li;
pub mod wu;
pub mod yu;

mod chart;
mod text;

use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

pub use chart::DrawError;

/// One of the papers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paper {
    /// Wu 2024: step Bresenham and velocity-adaptive extrusion.
    Wu,
    /// Yu 2019: planning on the computer, look-ahead.
    Yu,
    /// CoreXY plane control: three ways to interpolate.
    CoreXy,
    /// Li 2017: S-curve acceleration.
    Li,
}

impl Paper {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Wu, Self::Yu, Self::CoreXy, Self::Li];

    /// Its tables and figures.
    pub fn chapter(self) -> Chapter {
        match self {
            Self::Wu => wu::chapter(),
            Self::Yu => yu::chapter(),
            Self::CoreXy => corexy::chapter(),
            Self::Li => li::chapter(),
        }
    }
}

/// What is made anew of a paper.
#[derive(Clone, Debug, Serialize)]
pub struct Chapter {
    /// Short name: `wu` ...
    pub name: &'static str,
    /// The paper's title and place.
    pub source: &'static str,
    /// Its tables.
    pub tables: Vec<Table>,
    /// Its figures.
    pub figures: Vec<Figure>,
}

/// A table.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// Key in JSON, `lower_case`.
    pub key: &'static str,
    /// What it shows, and which table of the paper it stands beside.
    pub title: String,
    /// Heads of its columns, units included.
    pub columns: Vec<&'static str>,
    /// Its rows, each as long as the head.
    pub rows: Vec<Vec<Cell>>,
    /// What to know when reading it; perhaps nothing.
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
    /// A number shown with so many decimals.
    #[serde(serialize_with = "bare_number")]
    Number(f64, usize),
    /// Nothing.
    Empty,
}

/// A number as such: who reads JSON rounds for himself.
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
    /// What it shows, and which figure of the paper it stands beside.
    pub title: String,
    /// What is to the right, with its unit.
    pub x_label: &'static str,
    /// What is upwards, with its unit.
    pub y_label: &'static str,
    /// Whether a unit is as long in both directions.
    pub equal_scales: bool,
    /// What is drawn.
    pub curves: Vec<Curve>,
}

/// Points that belong together.
#[derive(Clone, Debug, Serialize)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// How it is drawn.
    pub style: Style,
    /// In their order.
    pub points: Vec<(f64, f64)>,
}

/// How points are drawn.
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

impl Table {
    /// As text.
    pub fn text(&self) -> String {
        text::of_table(self)
    }
}

impl Chapter {
    /// Its tables as text.
    pub fn text(&self) -> String {
        text::of(self)
    }

    /// Draws its figures into a folder, which is made where there is none. Where they are.
    ///
    /// # Errors
    /// The folder or a file cannot be written.
    pub fn draw(&self, folder: &Path) -> Result<Vec<PathBuf>, DrawError> {
        std::fs::create_dir_all(folder).map_err(|error| DrawError::new(folder, error))?;
        self.figures.iter().map(|figure| chart::draw(figure, folder)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_chapter_is_whole() {
        for paper in Paper::ALL {
            let chapter = paper.chapter();
            assert!(!chapter.tables.is_empty(), "{}", chapter.name);
            for table in &chapter.tables {
                assert!(!table.rows.is_empty(), "{}", table.title);
                assert!(table.rows.iter().all(|row| row.len() == table.columns.len()), "{}", table.title);
                let numbers = table.rows.iter().flatten();
                assert!(numbers.into_iter().all(|cell| !matches!(cell, Cell::Number(x, _) if !x.is_finite())));
            }
            for figure in &chapter.figures {
                let mut points = figure.curves.iter().flat_map(|curve| &curve.points);
                assert!(points.clone().count() > 1 && points.all(|(x, y)| x.is_finite() && y.is_finite()));
            }
        }
    }
}
