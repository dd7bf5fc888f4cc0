//! A key that has been read: its default and its meaning.

use std::fmt;

use crate::schema::Key;
use crate::section::Section;

/// A key of a [`Section`], read from its text. One of [`required`](Self::required),
/// [`or`](Self::or) and [`optional`](Self::optional) sets its value for texts without the key, and
/// its meaning, in the book's words.
#[must_use = "a key is declared by `required`, `or` or `optional`"]
pub struct Field<'r, T> {
    section: Section<'r>,
    /// The key's place in the schema.
    row: usize,
    key: Key,
    /// The right values, in a refusal's words.
    expected: String,
    value: Option<T>,
    /// Replaces a value that is missing or wrong.
    stand_in: T,
    /// A value in the book's words.
    show: Box<dyn Fn(&T) -> String>,
}

impl<'r, T: Clone + fmt::Debug> Field<'r, T> {
    pub(crate) fn new(
        section: &Section<'r>,
        name: &'static str,
        stand_in: T,
        value: Option<T>,
        show: impl Fn(&T) -> String + 'static,
    ) -> Self {
        let row = section.reserve_row();
        let key = Key { name, path: section.path(name), ..Key::default() };
        Self { section: section.clone(), row, key, expected: String::new(), value, stand_in, show: Box::new(show) }
    }

    /// Describes the right values: in a refusal's words, and in the book's with the unit apart.
    pub(crate) fn described(mut self, expected: String, allowed: String, unit: &'static str) -> Self {
        self.expected = expected;
        self.key.allowed = allowed;
        self.key.unit = unit;
        self
    }

    /// Names of the keys in a table that counts as one value.
    pub(crate) fn with_names(mut self, names: Vec<&'static str>) -> Self {
        self.key.names = names;
        self
    }

    pub(crate) fn with_value(mut self, value: T) -> Self {
        self.value = Some(value);
        self
    }

    pub(crate) fn value(&self) -> Option<&T> {
        self.value.as_ref()
    }

    /// The value of a key that must be there.
    pub fn required(self, about: &'static str) -> T {
        self.section.expect(self.key.name, &self.expected);
        let value = self.value.unwrap_or(self.stand_in);
        self.section.note(self.row, Key { about, ..self.key }, &value);
        value
    }

    /// The value; `None` if the key is left out, for which `absent` is the book's text.
    pub fn optional(self, absent: &'static str, about: &'static str) -> Option<T> {
        let key = Key { about, absent: absent.to_owned(), ..self.key };
        self.section.note(self.row, key, &self.value);
        self.value
    }

    /// The value, or this one if the key is left out.
    pub fn or(self, default: T, about: &'static str) -> T {
        let absent = (self.show)(&default);
        let value = self.value.unwrap_or(default);
        self.section.note(self.row, Key { about, absent, ..self.key }, &value);
        value
    }
}
