//! A text that is read key by key: each call declares a key and yields its value.
//!
//! Reading continues after a fault with a substitute value: all keys are declared whatever the text
//! says. [`Reader::finish`] then reports the most basic fault: unknown keys, wrong types, missing
//! keys, values out of their range, and last values that contradict each other. A reader without a
//! text [describes](Reader::describe) the keys.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{FileError, Problem};
use crate::locate::{line_of, one_line};
use crate::schema::Key;
use crate::words::{closest, join, one_of};

/// A text, its keys as far as they are read, and its faults.
pub struct Reader<'a> {
    origin: &'a str,
    pub(crate) text: &'a str,
    /// `None` while a schema is described.
    pub(crate) root: Option<Spanned<DeTable<'a>>>,
    pub(crate) state: RefCell<State>,
}

/// Findings of the reading so far.
#[derive(Default)]
pub(crate) struct State {
    pub keys: Vec<Key>,
    /// Names of keys by the path of their table.
    pub names: BTreeMap<String, Vec<&'static str>>,
    /// The value of each key, as refusals show it, and its line.
    pub shown: BTreeMap<String, (String, Option<usize>)>,
    /// Values that count as the same file's, by the keys' paths.
    pub bound: BTreeMap<String, String>,
    faults: Vec<(Rank, FileError)>,
}

/// Order of faults, most basic first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Rank {
    Unknown,
    Type,
    Missing,
    Range,
    Contradiction,
}

/// A value that was read well, with a hash of all its [bound](crate::Section::apart) keys
/// and their values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checked<T> {
    /// The value.
    pub value: T,
    /// FNV-1a-64 over the lines `path=value` of the bound keys, sorted; values left out count
    /// as their defaults.
    pub hash: u64,
}

impl<'a> Reader<'a> {
    /// Reads `text`; `origin` (a path or a name) precedes the line number in errors.
    ///
    /// # Errors
    /// The text is not TOML.
    pub fn new(text: &'a str, origin: &'a str) -> Result<Self, FileError> {
        let root = DeTable::parse(text).map_err(|error| {
            let line = line_of(text, error.span().unwrap_or(0..0).start);
            FileError::new(origin, Some(line), Problem::Syntax(one_line(error.message())))
        })?;
        Ok(Self { origin, text, root: Some(root), state: RefCell::default() })
    }

    /// A reader without a text, to which keys are declared.
    pub(crate) fn without_text() -> Self {
        Self { origin: "", text: "", root: None, state: RefCell::default() }
    }

    /// The value that was read, if the text is free of faults.
    ///
    /// # Errors
    /// The most basic fault; among several, the first found.
    pub fn finish<T>(self, value: T) -> Result<Checked<T>, FileError> {
        if let Some(root) = &self.root {
            self.find_unknown_keys(root.get_ref(), "");
        }
        let State { bound, mut faults, .. } = self.state.into_inner();
        faults.sort_by_key(|(rank, _)| *rank);
        match faults.into_iter().next() {
            Some((_, fault)) => Err(fault),
            None => Ok(Checked { value, hash: fnv_1a(&bound) }),
        }
    }

    /// Refuses the value of a key, by its full path, that contradicts another or cannot be served.
    pub fn refuse(&self, path: &str, expected: impl fmt::Display) {
        let known = self.state.borrow().shown.get(path).cloned();
        let (value, line) = known.unwrap_or_else(|| ("(left out)".to_owned(), None));
        let problem = Problem::OutOfRange { key: path.to_owned(), value, expected: expected.to_string() };
        self.fault(Rank::Contradiction, line, problem);
    }

    /// Line of the value of a key that was read, counted from 1.
    pub fn line(&self, path: &str) -> Option<usize> {
        self.state.borrow().shown.get(path).and_then(|(_, line)| *line)
    }

    pub(crate) fn fault(&self, rank: Rank, line: Option<usize>, problem: Problem) {
        self.state.borrow_mut().faults.push((rank, FileError::new(self.origin, line, problem)));
    }

    fn find_unknown_keys(&self, table: &DeTable<'_>, path: &str) {
        // Tables of which no key was read are unknown themselves.
        let Some(names) = self.state.borrow().names.get(path).cloned() else { return };
        for (key, value) in table {
            let inner = join(path, key.get_ref());
            if !names.iter().any(|name| *name == key.get_ref()) {
                let line = Some(line_of(self.text, key.span().start));
                let meant = closest(key.get_ref(), names.iter().copied()).map(str::to_owned);
                let problem = Problem::UnknownKey { key: one_line(&inner), meant, expected: one_of(&names) };
                self.fault(Rank::Unknown, line, problem);
            } else if let DeValue::Table(table) = value.get_ref() {
                self.find_unknown_keys(table, &inner);
            }
        }
    }
}

/// FNV-1a, 64 bits, over lines `path=value`.
fn fnv_1a(values: &BTreeMap<String, String>) -> u64 {
    let lines = values.iter().flat_map(|(path, value)| format!("{path}={value}\n").into_bytes());
    lines.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
