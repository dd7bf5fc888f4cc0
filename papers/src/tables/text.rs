//! Plain-text tables for a terminal.

use comfy_table::presets::ASCII_MARKDOWN;
use comfy_table::{CellAlignment, ContentArrangement};

use super::chapter::{Cell, Chapter, Table};

/// All tables of a chapter.
pub(super) fn of(chapter: &Chapter) -> String {
    let mut text = format!("{}\n", chapter.source);
    for table in &chapter.tables {
        text.push('\n');
        text.push_str(&of_table(table));
    }
    text
}

/// A table with its title above and its note below.
pub(super) fn of_table(table: &Table) -> String {
    let text = format!("{}\n\n{}\n", table.title, lines(table));
    if table.note.is_empty() { text } else { format!("{text}\n{}\n", table.note) }
}

fn lines(table: &Table) -> comfy_table::Table {
    let mut shown = comfy_table::Table::new();
    shown.load_style(ASCII_MARKDOWN).set_content_arrangement(ContentArrangement::Disabled);
    shown.set_header(table.columns.iter());
    for row in &table.rows {
        shown.add_row(row.iter().map(cell));
    }
    shown
}

fn cell(cell: &Cell) -> comfy_table::Cell {
    let (text, alignment) = match cell {
        Cell::Text(text) => (text.clone(), CellAlignment::Left),
        Cell::Count(count) => (count.to_string(), CellAlignment::Right),
        Cell::Number(number, decimals) => (format!("{number:.decimals$}"), CellAlignment::Right),
        Cell::Empty => (String::new(), CellAlignment::Left),
    };
    comfy_table::Cell::new(text).set_alignment(alignment)
}
