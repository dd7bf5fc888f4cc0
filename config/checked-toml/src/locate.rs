//! Lines of a text, and of its keys.

use toml::de::{DeTable, DeValue};

/// Line of a byte offset, counted from 1.
pub fn line_of(text: &str, offset: usize) -> usize {
    let before = text.as_bytes().get(..offset).unwrap_or(text.as_bytes());
    1 + before.iter().filter(|byte| **byte == b'\n').count()
}

/// Line of the value of a key (a path with dots); `None` if the text has no such key.
pub fn line_of_key(text: &str, key: &str) -> Option<usize> {
    let root = DeTable::parse(text).ok()?;
    let (tables, last) = key.rsplit_once('.').map_or((None, key), |(tables, last)| (Some(tables), last));
    let mut table = root.get_ref();
    for name in tables.into_iter().flat_map(|tables| tables.split('.')) {
        table = match table.get(name)?.get_ref() {
            DeValue::Table(inner) => inner,
            _ => return None,
        };
    }
    Some(line_of(text, table.get(last)?.span().start))
}

/// Longest text that a one-line error quotes, characters.
const MAX_QUOTED: usize = 80;

/// The text in one line, shortened: errors are one line each.
pub(crate) fn one_line(text: &str) -> String {
    let line = text.lines().map(str::trim).collect::<Vec<_>>().join("; ");
    match line.char_indices().nth(MAX_QUOTED) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line,
    }
}
