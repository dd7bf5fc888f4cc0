//! One table of a text: a method for each kind of value.

use std::fmt;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::Problem;
use crate::field::Field;
use crate::locate::{line_of, one_line};
use crate::range::{Range, book_number};
use crate::reader::{Rank, Reader};
use crate::schema::Key;

/// What a word can mean.
pub trait Choice: Copy + PartialEq + fmt::Debug + 'static {}

impl<T: Copy + PartialEq + fmt::Debug + 'static> Choice for T {}

/// A table whose keys are being read.
#[derive(Clone)]
pub struct Section<'r> {
    reader: &'r Reader<'r>,
    path: String,
    /// `None` where the text has no such table, and while a schema is described.
    table: Option<&'r DeTable<'r>>,
    line: Option<usize>,
    is_bound: bool,
}

impl<'r> Section<'r> {
    /// The table of the keys that stand in no table.
    pub(crate) fn root(reader: &'r Reader<'r>, table: Option<&'r DeTable<'r>>) -> Self {
        Self { reader, path: String::new(), table, line: None, is_bound: true }
    }

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

    /// A table that must be there.
    pub fn section(&self, key: &'static str, about: &'static str) -> Self {
        self.expect(key, "a table");
        self.open(key, about, "").0
    }

    /// A table that may be left out with all its keys, each of which has a default.
    pub fn section_of_defaults(&self, key: &'static str, about: &'static str) -> Self {
        self.open(key, about, "each key its default").0
    }

    /// A table that may be left out; `absent` says what holds then. While a schema is described it is there.
    pub fn optional_section(&self, key: &'static str, absent: &'static str, about: &'static str) -> Option<Self> {
        let (inner, is_missing) = self.open(key, about, absent);
        (!is_missing || self.is_describing()).then_some(inner)
    }

    /// A number.
    pub fn number(&self, key: &'static str, range: Range) -> Field<'r, f64> {
        self.declare(key);
        let value = self.value(key).and_then(|value| self.number_in(&self.path(key), value, range));
        Field::new(self, key, range.low, value, |number| book_number(*number)).described(
            range.to_string(),
            range.for_book(),
            range.unit,
        )
    }

    /// A whole number.
    pub fn whole(&self, key: &'static str, range: Range) -> Field<'r, f64> {
        let field = self.number(key, range);
        if field.value().is_some_and(|number| number.fract() != 0.0) {
            let (shown, line) = self.shown_of(key);
            let expected = format!("a whole number from {range}");
            self.reader.fault(Rank::Range, line, Problem::OutOfRange { key: self.path(key), value: shown, expected });
        }
        let (words, book) = (format!("a whole number from {range}"), format!("whole, {}", range.for_book()));
        field.described(words, book, range.unit)
    }

    /// A table of one number for each name, such as `{ x = 1, y = 2 }`.
    pub fn numbers<const N: usize>(
        &self,
        key: &'static str,
        names: [&'static str; N],
        ranges: [Range; N],
    ) -> Field<'r, [f64; N]> {
        self.declare(key);
        let path = self.path(key);
        let words = format!("a table with the keys {}", names.join(", "));
        let lows = ranges.map(|range| range.low);
        let value = self.value(key).and_then(|value| {
            let DeValue::Table(table) = value.get_ref() else { return self.wrong_type(&path, value, &words) };
            self.reader.state.borrow_mut().names.insert(path.clone(), names.to_vec());
            let mut numbers = lows;
            for ((name, range), number) in names.into_iter().zip(ranges).zip(&mut numbers) {
                let inner = join(&path, name);
                match table.get(name) {
                    Some(value) => *number = self.number_in(&inner, value, range).unwrap_or(range.low),
                    None => {
                        let line = Some(line_of(self.reader.text, value.span().start));
                        let problem = Problem::MissingKey { key: inner, expected: range.to_string() };
                        self.reader.fault(Rank::Missing, line, problem);
                    }
                }
            }
            Some(numbers)
        });
        let unit = ranges.first().map_or("", |range| range.unit);
        let all_same = ranges.windows(2).all(|pair| pair[0].for_book() == pair[1].for_book());
        let each: Vec<String> = if all_same {
            ranges.iter().take(1).map(Range::for_book).collect()
        } else {
            names.iter().zip(&ranges).map(|(name, range)| format!("`{name}`: {}", range.for_book())).collect()
        };
        let show = |numbers: &[f64; N]| match numbers.windows(2).all(|pair| pair[0] == pair[1]) {
            true => numbers.first().map_or_else(String::new, |number| book_number(*number)),
            false => numbers.map(book_number).join(", "),
        };
        Field::new(self, key, lows, value, show).described(words, each.join("; "), unit).with_names(names.to_vec())
    }

    /// Two numbers, a lower and an upper end, such as `[0, 180]`.
    pub fn ends(&self, key: &'static str, range: Range) -> Field<'r, [f64; 2]> {
        self.declare(key);
        let words = format!("a lower and an upper end within {range}, such as [0, 180]");
        let value = self.value(key).and_then(|value| {
            let ends = value.get_ref().as_array().map(|array| array.iter().map(|end| number(end.get_ref())));
            let ends = ends.and_then(Iterator::collect::<Option<Vec<f64>>>);
            let Some([lower, upper]) = ends.as_deref() else { return self.wrong_type(&self.path(key), value, &words) };
            let ends = [*lower, *upper];
            if !ends.iter().all(|end| range.contains(*end)) || lower >= upper {
                return self.out_of_range(&self.path(key), value, &words);
            }
            Some(ends)
        });
        let book = format!("lower and upper end, such as `[0, 180]`, within {}", range.for_book());
        let show = |ends: &[f64; 2]| ends.map(book_number).join(" to ");
        Field::new(self, key, [range.low, range.high], value, show).described(words, book, range.unit)
    }

    /// `true` or `false`.
    pub fn flag(&self, key: &'static str) -> Field<'r, bool> {
        self.declare(key);
        let words = "true or false";
        let value = self.value(key).and_then(|value| match value.get_ref() {
            DeValue::Boolean(flag) => Some(*flag),
            _ => self.wrong_type(&self.path(key), value, words),
        });
        let show = |flag: &bool| format!("`{flag}`");
        Field::new(self, key, false, value, show).described(words.to_owned(), "`true` or `false`".to_owned(), "")
    }

    /// One of some words, each with its meaning; there is at least one.
    pub fn word<T: Choice, const N: usize>(&self, key: &'static str, choices: [(&'static str, T); N]) -> Field<'r, T> {
        let words = one_of(choices.iter().map(|(word, _)| word));
        let book = one_of_in_book(&choices);
        self.word_as(key, choices, words, book)
    }

    fn word_as<T: Choice, const N: usize>(
        &self,
        key: &'static str,
        choices: [(&'static str, T); N],
        words: String,
        book: String,
    ) -> Field<'r, T> {
        self.declare(key);
        let value = self.value(key).and_then(|value| {
            let chosen = value.get_ref().as_str().and_then(|text| meaning(&choices, text));
            chosen.or_else(|| self.wrong_type(&self.path(key), value, &words))
        });
        let (_, first) = choices[0];
        let show = move |value: &T| {
            let word = choices.iter().find(|(_, meaning)| meaning == value);
            word.map_or_else(String::new, |(word, _)| format!("`\"{word}\"`"))
        };
        Field::new(self, key, first, value, show).described(words, book, "")
    }

    /// Some of some words, in any order, such as `["x", "e"]`.
    pub fn words<T: Choice, const N: usize>(
        &self,
        key: &'static str,
        choices: [(&'static str, T); N],
    ) -> Field<'r, Vec<T>> {
        self.declare(key);
        let words = format!("a list of {}", one_of(choices.iter().map(|(word, _)| word)));
        let value = self.value(key).and_then(|value| {
            let Some(list) = value.get_ref().as_array() else { return self.wrong_type(&self.path(key), value, &words) };
            let meanings: Option<Vec<T>> =
                list.iter().map(|word| meaning(&choices, word.get_ref().as_str()?)).collect();
            meanings.or_else(|| self.wrong_type(&self.path(key), value, &words))
        });
        let book = format!("a list of {}", one_of_in_book(&choices));
        Field::new(self, key, Vec::new(), value, |_| "none".to_owned()).described(words, book, "")
    }

    /// One of some words, or a table that `read` makes the same kind of value from.
    pub fn word_or_section<T: Choice, const N: usize>(
        &self,
        key: &'static str,
        choices: [(&'static str, T); N],
        example: &'static str,
        read: impl FnOnce(&Self) -> T,
    ) -> Field<'r, T> {
        let words = format!("{} or a table such as {example}", one_of(choices.iter().map(|(word, _)| word)));
        let book = format!("{} or a table such as `{example}`", one_of_in_book(&choices));
        let table = self.table.and_then(|table| table.get(key)).and_then(|value| value.get_ref().as_table());
        if table.is_none() && !self.is_describing() {
            return self.word_as(key, choices, words, book);
        }
        self.declare(key);
        self.value(key);
        let field = Field::new(self, key, choices[0].1, None, |_| String::new()).described(words, book, "");
        field.with_value(read(&self.inner(key, table)))
    }

    /// Any text that passes a check; `expected` says in words which.
    pub fn text(&self, key: &'static str, expected: &str, is_right: impl FnOnce(&str) -> bool) -> Field<'r, String> {
        self.declare(key);
        let value = self.value(key).and_then(|value| match value.get_ref().as_str() {
            None => self.wrong_type(&self.path(key), value, expected),
            Some(text) if is_right(text) => Some(text.to_owned()),
            Some(_) => self.out_of_range(&self.path(key), value, &expected),
        });
        let show = |text: &String| format!("`\"{text}\"`");
        Field::new(self, key, String::new(), value, show).described(expected.to_owned(), expected.to_owned(), "")
    }

    /// Whether there is no text at all.
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

    fn inner(&self, key: &str, table: Option<&'r DeTable<'r>>) -> Self {
        let path = self.path(key);
        self.reader.state.borrow_mut().names.entry(path.clone()).or_default();
        Section { reader: self.reader, table, line: self.shown_of(key).1, path, is_bound: self.is_bound }
    }

    /// A key that this table may have.
    fn declare(&self, key: &'static str) {
        let mut state = self.reader.state.borrow_mut();
        let names = state.names.entry(self.path.clone()).or_default();
        if !names.contains(&key) {
            names.push(key);
        }
    }

    /// The value of a key, noted with its line.
    fn value(&self, key: &str) -> Option<&'r Spanned<DeValue<'r>>> {
        let value = self.table?.get(key)?;
        self.show(&self.path(key), value);
        Some(value)
    }

    fn show(&self, path: &str, value: &Spanned<DeValue<'_>>) {
        let text = self.reader.text.get(value.span()).unwrap_or_default();
        let line = line_of(self.reader.text, value.span().start);
        self.reader.state.borrow_mut().shown.insert(path.to_owned(), (one_line(text), Some(line)));
    }

    fn shown_of(&self, key: &str) -> (String, Option<usize>) {
        self.reader.state.borrow().shown.get(&self.path(key)).cloned().unwrap_or_default()
    }

    fn number_in(&self, path: &str, value: &Spanned<DeValue<'_>>, range: Range) -> Option<f64> {
        self.show(path, value);
        let Some(number) = number(value.get_ref()) else {
            return self.wrong_type(path, value, &format!("a number from {range}"));
        };
        if range.contains(number) { Some(number) } else { self.out_of_range(path, value, &range) }
    }

    fn wrong_type<T>(&self, path: &str, value: &Spanned<DeValue<'_>>, expected: &str) -> Option<T> {
        let (shown, line) = self.found(value);
        let problem = Problem::WrongType { key: path.to_owned(), value: shown, expected: expected.to_owned() };
        self.reader.fault(Rank::Type, Some(line), problem);
        None
    }

    fn out_of_range<T>(&self, path: &str, value: &Spanned<DeValue<'_>>, expected: &dyn fmt::Display) -> Option<T> {
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

/// A TOML integer or float; integers beyond 128 bits are as good as infinite.
fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(integer) => {
            let number = i128::from_str_radix(integer.as_str(), integer.radix());
            Some(number.map_or(f64::INFINITY, |number| number as f64))
        }
        DeValue::Float(float) => float.as_str().parse().ok(),
        _ => None,
    }
}

fn meaning<T: Choice>(choices: &[(&'static str, T)], text: &str) -> Option<T> {
    choices.iter().find(|(word, _)| *word == text).map(|(_, meaning)| *meaning)
}

/// A key within a table's path.
pub(crate) fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// `"a", "b" or "c"`.
pub(crate) fn one_of(words: impl IntoIterator<Item = impl AsRef<str>>) -> String {
    alternatives(words.into_iter().map(|word| format!("\"{}\"", word.as_ref())).collect())
}

/// The same as code.
fn one_of_in_book<T>(choices: &[(&'static str, T)]) -> String {
    alternatives(choices.iter().map(|(word, _)| format!("`\"{word}\"`")).collect())
}

fn alternatives(mut words: Vec<String>) -> String {
    match words.pop() {
        None => "no key".to_owned(),
        Some(last) if words.is_empty() => last,
        Some(last) => format!("{} or {last}", words.join(", ")),
    }
}
