//! From the TOML reader's errors to the key and line they are about.
//!
//! The reader names a missing or unknown field without the tables around it, but says where in the text it was. A
//! second, untyped reading of the same text finds the path that leads there.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{FileError, Problem};

/// A table's or value's path and the spans of its key and of itself.
struct Place {
    path: String,
    key_span: Range<usize>,
    value_span: Range<usize>,
    is_table: bool,
}

/// Says what the reader's error is about: the full key and the line.
pub fn explain(error: &toml::de::Error, text: &str, origin: &str) -> FileError {
    let span = error.span().unwrap_or(0..0);
    let line = line_of(text, span.start);
    let Ok(root) = DeTable::parse(text) else {
        let problem = Problem::Syntax(one_line(error.message()));
        return FileError::new(origin, Some(line), problem);
    };
    let mut places = Vec::new();
    collect(root.get_ref(), "", &mut places);

    // Tables first seen in a header such as [homing.x] share its span: the deepest, collected last, is meant.
    let at = |wanted: &dyn Fn(&Place) -> bool| places.iter().rev().find(|place| wanted(place));
    let message = error.message();
    if let Some(name) = quoted_after(message, "missing field `") {
        let table = at(&|place| place.is_table && (place.value_span == span || place.key_span == span));
        let problem =
            Problem::MissingKey { key: table.map_or_else(|| name.to_owned(), |table| join(&table.path, name)) };
        // A key missing at the top level is missing everywhere: no line is to blame.
        return FileError::new(origin, table.map(|_| line), problem);
    }
    if let Some(name) = quoted_after(message, "unknown field `") {
        let key = at(&|place| place.key_span == span).map_or(name, |place| place.path.as_str());
        let expected = message.split_once(", expected ").map_or("no key here", |(_, rest)| rest);
        let problem = Problem::UnknownKey { key: key.to_owned(), expected: expected.replace('`', "\"") };
        return FileError::new(origin, Some(line), problem);
    }
    let place = at(&|place| place.value_span == span || place.key_span == span);
    let problem = Problem::WrongType {
        key: place.map_or_else(String::new, |place| place.path.clone()),
        message: one_line(message)
            .replace("expected f64", "expected a number")
            .replace("unknown variant", "unknown word")
            .replace('`', "\""),
    };
    FileError::new(origin, Some(line), problem)
}

/// Line of a byte offset, counted from 1.
pub fn line_of(text: &str, offset: usize) -> usize {
    let before = text.as_bytes().get(..offset).unwrap_or(text.as_bytes());
    1 + before.iter().filter(|byte| **byte == b'\n').count()
}

/// Line on which the value of a key (a path with dots) stands; `None` if the text has no such key.
pub fn line_of_key(text: &str, key: &str) -> Option<usize> {
    let root = DeTable::parse(text).ok()?;
    let mut places = Vec::new();
    collect(root.get_ref(), "", &mut places);
    places.iter().rev().find(|place| place.path == key).map(|place| line_of(text, place.value_span.start))
}

/// All keys below a table, a table before its contents.
fn collect(table: &DeTable<'_>, path: &str, places: &mut Vec<Place>) {
    for (key, value) in table {
        let path = join(path, key.get_ref());
        places.push(Place {
            path: path.clone(),
            key_span: key.span(),
            value_span: value.span(),
            is_table: value.get_ref().is_table(),
        });
        descend(value, &path, places);
    }
}

/// The keys inside a value, those in an array's elements among them.
fn descend(value: &Spanned<DeValue<'_>>, path: &str, places: &mut Vec<Place>) {
    match value.get_ref() {
        DeValue::Table(table) => collect(table, path, places),
        DeValue::Array(array) => {
            for element in array {
                descend(element, path, places);
            }
        }
        _ => {}
    }
}

/// A key within a table's path.
fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// The name between `prefix` and the closing back quote.
fn quoted_after<'a>(message: &'a str, prefix: &str) -> Option<&'a str> {
    let rest = message.strip_prefix(prefix)?;
    rest.rsplit_once("`, expected ").or_else(|| rest.rsplit_once('`')).map(|(name, _)| name)
}

/// The message with its line breaks taken out: errors are one line each.
fn one_line(message: &str) -> String {
    message.lines().collect::<Vec<_>>().join("; ")
}
