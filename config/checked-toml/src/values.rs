//! The keys of a table: a method for each kind of value.

use std::fmt;

use toml::Spanned;
use toml::de::DeValue;

use crate::error::Problem;
use crate::field::Field;
use crate::locate::line_of;
use crate::range::{Range, book_number};
use crate::reader::Rank;
use crate::section::Section;
use crate::words::{join, one_of, one_of_in_book};

/// Meaning of a word in a file.
pub trait Choice: Copy + PartialEq + fmt::Debug + 'static {}

impl<T: Copy + PartialEq + fmt::Debug + 'static> Choice for T {}

/// A list of N numbers.
fn array<const N: usize>(value: &DeValue<'_>) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(|one| number(one.get_ref())).collect();
    numbers?.try_into().ok()
}

impl<'r> Section<'r> {
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
            let Some(ends) = array(value.get_ref()) else { return self.wrong_type(&self.path(key), value, &words) };
            let [lower, upper] = ends;
            if !ends.iter().all(|end| range.contains(*end)) || lower >= upper {
                return self.out_of_range(&self.path(key), value, &words);
            }
            Some(ends)
        });
        let book = format!("lower and upper end, such as `[0, 180]`, within {}", range.for_book());
        let show = |ends: &[f64; 2]| ends.map(book_number).join(" to ");
        Field::new(self, key, [range.low, range.high], value, show).described(words, book, range.unit)
    }

    /// A list of N numbers in any order; `example` is one.
    pub fn several<const N: usize>(
        &self,
        key: &'static str,
        range: Range,
        example: &'static str,
    ) -> Field<'r, [f64; N]> {
        self.declare(key);
        let words = format!("{N} numbers within {range}, such as {example}");
        let value = self.value(key).and_then(|value| {
            let Some(numbers) = array(value.get_ref()) else { return self.wrong_type(&self.path(key), value, &words) };
            if !numbers.iter().all(|number| range.contains(*number)) {
                return self.out_of_range(&self.path(key), value, &words);
            }
            Some(numbers)
        });
        let book = format!("{N} numbers, such as `{example}`, within {}", range.for_book());
        let show = |numbers: &[f64; N]| numbers.map(book_number).join(", ");
        Field::new(self, key, [range.low; N], value, show).described(words, book, range.unit)
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
        self.word_as(key, choices, words, book, |_| None)
    }

    /// One of some words, each with its meaning, or a text such as `example` that `read` knows.
    pub fn word_or<T: Choice, const N: usize>(
        &self,
        key: &'static str,
        choices: [(&'static str, T); N],
        example: &'static str,
        read: impl Fn(&str) -> Option<T>,
    ) -> Field<'r, T> {
        let words = format!("{} or a value such as \"{example}\"", one_of(choices.iter().map(|(word, _)| word)));
        let book = format!("{} or a value such as `\"{example}\"`", one_of_in_book(&choices));
        self.word_as(key, choices, words, book, read)
    }

    fn word_as<T: Choice, const N: usize>(
        &self,
        key: &'static str,
        choices: [(&'static str, T); N],
        words: String,
        book: String,
        read: impl Fn(&str) -> Option<T>,
    ) -> Field<'r, T> {
        self.declare(key);
        let value = self.value(key).and_then(|value| {
            let chosen = value.get_ref().as_str().and_then(|text| meaning(&choices, text).or_else(|| read(text)));
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
            return self.word_as(key, choices, words, book, |_| None);
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

    /// A text of several lines, each with its line number in the file. `expected`
    /// describes them in words.
    pub fn lines(&self, key: &'static str, expected: &str) -> Field<'r, Vec<(usize, String)>> {
        self.declare(key);
        let value = self.value(key).and_then(|value| {
            let Some(text) = value.get_ref().as_str() else { return self.wrong_type(&self.path(key), value, expected) };
            let written = self.reader.text.get(value.span()).unwrap_or_default();
            // TOML drops a newline right after the opening quotes.
            let begins_below = ["\"\"\"", "'''"].iter().any(|quotes| {
                written.strip_prefix(quotes).is_some_and(|rest| rest.starts_with('\n') || rest.starts_with("\r\n"))
            });
            let first = line_of(self.reader.text, value.span().start) + usize::from(begins_below);
            Some((first..).zip(text.lines().map(str::to_owned)).collect())
        });
        Field::new(self, key, Vec::new(), value, |_| String::new()).described(
            expected.to_owned(),
            expected.to_owned(),
            "",
        )
    }

    fn number_in(&self, path: &str, value: &Spanned<DeValue<'_>>, range: Range) -> Option<f64> {
        self.show(path, value);
        let Some(number) = number(value.get_ref()) else {
            return self.wrong_type(path, value, &format!("a number from {range}"));
        };
        if range.contains(number) { Some(number) } else { self.out_of_range(path, value, &range) }
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
