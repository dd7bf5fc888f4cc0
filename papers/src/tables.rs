//! Reproductions of the papers' tables and figures, as printed by `ferrostep papers`.
//!
//! A chapter is data; text, JSON and pictures are made from it in one place for all papers.

pub mod corexy;
pub mod li;
pub mod wu;
pub mod yu;

mod chapter;
mod chart;
mod example_machine;
mod text;

use std::path::{Path, PathBuf};

pub use chapter::{Cell, Chapter, Curve, Figure, Style, Table};
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
    /// All papers.
    pub const ALL: [Self; 4] = [Self::Wu, Self::Yu, Self::CoreXy, Self::Li];

    /// Tables and figures of the paper.
    pub fn chapter(self) -> Chapter {
        match self {
            Self::Wu => wu::chapter(),
            Self::Yu => yu::chapter(),
            Self::CoreXy => corexy::chapter(),
            Self::Li => li::chapter(),
        }
    }
}

impl Table {
    /// The table as text.
    pub fn text(&self) -> String {
        text::of_table(self)
    }
}

impl Chapter {
    /// Tables of the chapter as text.
    pub fn text(&self) -> String {
        text::of(self)
    }

    /// Draws the chapter's figures into a folder, which is created if it is missing. Returns the
    /// paths of the files.
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
