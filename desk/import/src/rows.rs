//! The rows of a report, found by their settings.

use std::collections::HashMap;

use crate::effort;
use crate::imported::Row;

/// Rows in the order in which they came.
#[derive(Default)]
pub(crate) struct Rows {
    rows: Vec<Row>,
    /// The first row of each setting.
    places: HashMap<(String, usize, String), usize>,
}

impl Rows {
    /// Adds a row; returns its place.
    pub(crate) fn push(&mut self, row: Row) -> usize {
        let place = self.rows.len();
        self.places.entry((row.file.clone(), row.line, row.key.clone())).or_insert(place);
        self.rows.push(row);
        place
    }

    /// The place of the first row of the same setting.
    pub(crate) fn find(&self, row: &Row) -> Option<usize> {
        effort::count();
        self.places.get(&(row.file.clone(), row.line, row.key.clone())).copied()
    }

    /// The row at a place.
    pub(crate) fn get(&self, place: usize) -> Option<&Row> {
        self.rows.get(place)
    }

    /// The row at a place, to be changed.
    pub(crate) fn get_mut(&mut self, place: usize) -> Option<&mut Row> {
        self.rows.get_mut(place)
    }

    /// All rows, by file and line.
    pub(crate) fn into_sorted(mut self) -> Vec<Row> {
        self.rows.sort_by(|a, b| (&a.file, a.line).cmp(&(&b.file, b.line)));
        self.rows
    }
}
