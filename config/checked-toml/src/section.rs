//! One table of a text.

use std::fmt;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::Problem;
use crate::locate::{line_of, one_line};
use crate::reader::{Rank, Reader};
use crate::schema::{Key, Schema};
use crate::words::join;

/// A table whose keys are being read.
#[derive(Clone)]
pub struct Section<'r> {
    pub(crate) reader: &'r Reader<'r>,
    path: String,
    /// `None` where the text has no such table, and while a schema is described.
    pub(crate) table: Option<&'r DeTable<'r>>,
    line: Option<usize>,
    is_bound: bool,
}

impl Reader<'_> {
    /// The keys that `read` asks for.
    pub fn describe<T>(read: impl FnOnce(&Section<'_>) -> T) -> Schema {
        let reader = Reader::without_text();
        read(&reader.root());
        Schema::new(reader.state.into_inner().keys)
    }

    /// The root table, of the keys outside all tables.
    pub fn root(&self) -> Section<'_> {
        self.state.borrow_mut().names.entry(String::new()).or_default();
        let table = self.root.as_ref().map(Spanned::get_ref);
        Section { reader: self, path: String::new(), table, line: None, is_bound: true }
    }
}

impl<'r> Section<'r> {
    /// The same table, for keys that may differ between two files that otherwise count as the same.
    #[must_use]
    pub fn apart(&self) -> Self {
        Self { is_bound: false, ..self.clone() }
    }

    /// The same table, for keys in which two files must agree to count as the same.
    #[must_use]
    pub fn bound(&self) -> Self {
        Self { is_bound: true, ..self.clone() }
    }

    /// Full path of a key of this table.
    pub fn path(&self, key: &str) -> String {
        join(&self.path, key)
    }

    /// The whole text, to refuse a key of another table.
    pub fn reader(&self) -> &'r Reader<'r> {
        self.reader
    }

    /// Refuses the value of a key of this table that contradicts another.
    pub fn refuse(&self, key: &str, expected: impl fmt::Display) {
        self.reader.refuse(&self.path(key), expected);
    }

    /// Binds other files to this value in place of the key's own, from which it follows with keys
    /// that are read apart.
    pub fn bind(&self, key: &str, value: &dyn fmt::Debug) {
        self.reader.state.borrow_mut().bound.insert(self.path(key), format!("{value:?}"));
    }

    /// A table that must be there.
    pub fn section(&self, key: &'static str, about: &'static str) -> Self {
        self.expect(key, "a table");
        self.open(key, about, "").0
    }

    /// A table that may be left out with all its keys, each of which has a default.
    pub fn section_of_defaults(&self, key: &'static str, about: &'static str) -> Self {
        self.open(key, about, "each key its default").0
    }

    /// A table that may be left out; `absent` is the book's text for that. While a schema is
    /// described it is there.
    pub fn optional_section(&self, key: &'static str, absent: &'static str, about: &'static str) -> Option<Self> {
        let (inner, is_missing) = self.open(key, about, absent);
        (!is_missing || self.is_describing()).then_some(inner)
    }

    /// Tables whose names the writer of the text chooses, in the table `key`, which may be left
    /// out; in the order of their lines. In the schema they are one with this name. Each name is
    /// leaked, as keys are.
    pub fn named_sections(
        &self,
        key: &'static str,
        name_in_schema: &'static str,
        absent: &'static str,
        about: &'static str,
        about_each: &'static str,
    ) -> Vec<(&'static str, Self)> {
        let outer = self.open(key, about, absent).0;
        if self.is_describing() {
            return vec![(name_in_schema, outer.open(name_in_schema, about_each, "").0)];
        }
        let mut names: Vec<_> =
            outer.table.into_iter().flatten().map(|(key, _)| (key.span().start, key.get_ref())).collect();
        names.sort_unstable();
        let keep = |name: &str| -> &'static str { Box::leak(name.to_owned().into_boxed_str()) };
        let sections = names.into_iter().map(|(_, name)| keep(name));
        sections.map(|name| (name, outer.open(name, about_each, "").0)).collect()
    }

    /// Refuses one line of a text of several lines; `line` is its number in the file.
    pub fn refuse_line(&self, key: &str, line: usize, text: &str, expected: impl fmt::Display) {
        let (value, expected) = (format!("{text:?}"), expected.to_string());
        let problem = Problem::OutOfRange { key: self.path(key), value, expected };
        self.reader.fault(Rank::Contradiction, Some(line), problem);
    }

    /// True if the reader has no text and only describes the keys.
    pub(crate) fn is_describing(&self) -> bool {
        self.reader.root.is_none()
    }

    /// Notes a fault if the text has this table without this key.
    pub(crate) fn expect(&self, key: &str, expected: &str) {
        if self.table.is_some_and(|table| !table.contains_key(key)) {
            let problem = Problem::MissingKey { key: self.path(key), expected: expected.to_owned() };
            self.reader.fault(Rank::Missing, self.line, problem);
        }
    }

    /// Notes a key's line in the schema and its value; `value` as refusals would show a default.
    pub(crate) fn note(&self, row: usize, mut key: Key, value: &dyn fmt::Debug) {
        let path = self.path(key.name);
        let mut state = self.reader.state.borrow_mut();
        key.is_bound = self.is_bound;
        if self.is_bound {
            state.bound.insert(path.clone(), format!("{value:?}"));
        }
        state.shown.entry(path).or_insert_with(|| (format!("{value:?}"), None));
        if let Some(place) = state.keys.get_mut(row) {
            *place = key;
        }
    }

    /// A place in the schema for the key that is read next.
    pub(crate) fn reserve_row(&self) -> usize {
        let mut state = self.reader.state.borrow_mut();
        state.keys.push(Key::default());
        state.keys.len() - 1
    }

    /// A table within this one, and whether the text lacks it.
    fn open(&self, key: &'static str, about: &'static str, absent: &'static str) -> (Self, bool) {
        self.declare(key);
        let row = Key { name: key, path: self.path(key), about, absent: absent.to_owned(), ..Key::default() };
        self.reader.state.borrow_mut().keys.push(Key { is_section: true, ..row });
        let table = match self.value(key) {
            None => None,
            Some(value) => match value.get_ref() {
                DeValue::Table(table) => Some(table),
                _ => self.wrong_type(&self.path(key), value, "a table"),
            },
        };
        let is_missing = self.table.is_none_or(|table| !table.contains_key(key));
        (self.inner(key, table), is_missing)
    }

    pub(crate) fn inner(&self, key: &str, table: Option<&'r DeTable<'r>>) -> Self {
        let path = self.path(key);
        self.reader.state.borrow_mut().names.entry(path.clone()).or_default();
        Section { reader: self.reader, table, line: self.shown_of(key).1, path, is_bound: self.is_bound }
    }

    /// A key that this table may have.
    pub(crate) fn declare(&self, key: &'static str) {
        let mut state = self.reader.state.borrow_mut();
        let names = state.names.entry(self.path.clone()).or_default();
        if !names.contains(&key) {
            names.push(key);
        }
    }

    /// The value of a key, noted with its line.
    pub(crate) fn value(&self, key: &str) -> Option<&'r Spanned<DeValue<'r>>> {
        let value = self.table?.get(key)?;
        self.show(&self.path(key), value);
        Some(value)
    }

    pub(crate) fn show(&self, path: &str, value: &Spanned<DeValue<'_>>) {
        let text = self.reader.text.get(value.span()).unwrap_or_default();
        let line = line_of(self.reader.text, value.span().start);
        self.reader.state.borrow_mut().shown.insert(path.to_owned(), (one_line(text), Some(line)));
    }

    pub(crate) fn shown_of(&self, key: &str) -> (String, Option<usize>) {
        self.reader.state.borrow().shown.get(&self.path(key)).cloned().unwrap_or_default()
    }

    pub(crate) fn wrong_type<T>(&self, path: &str, value: &Spanned<DeValue<'_>>, expected: &str) -> Option<T> {
        let (shown, line) = self.found(value);
        let problem = Problem::WrongType { key: path.to_owned(), value: shown, expected: expected.to_owned() };
        self.reader.fault(Rank::Type, Some(line), problem);
        None
    }

    pub(crate) fn out_of_range<T>(
        &self,
        path: &str,
        value: &Spanned<DeValue<'_>>,
        expected: &dyn fmt::Display,
    ) -> Option<T> {
        let (shown, line) = self.found(value);
        let problem = Problem::OutOfRange { key: path.to_owned(), value: shown, expected: expected.to_string() };
        self.reader.fault(Rank::Range, Some(line), problem);
        None
    }

    fn found(&self, value: &Spanned<DeValue<'_>>) -> (String, usize) {
        let text = self.reader.text.get(value.span()).unwrap_or_default();
        (one_line(text), line_of(self.reader.text, value.span().start))
    }
}
