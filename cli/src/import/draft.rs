//! A profile that is being made: values over those of a built-in one.

use std::collections::BTreeMap;

use ferrostep_checked_toml::keys::paths;
use toml::{Table, Value};

use super::{ImportError, Imported, Row};

/// The built-in profile whose values stand in.
const BASE: &str = "cartesian";

/// Most values that are given up because the checks of profiles refuse them.
const MAX_REFUSED: usize = 50;

/// A profile that is being made.
pub struct Draft {
    base: Table,
    table: Table,
    /// The rows that set each key, by its path.
    set_by: BTreeMap<String, usize>,
    rows: Vec<Row>,
}

impl Draft {
    /// One that says nothing yet.
    pub fn new() -> Self {
        let base: Table = ferrostep_profiles::builtin_text(BASE).and_then(|text| text.parse().ok()).unwrap_or_default();
        let mut draft = Self { table: base.clone(), base, set_by: BTreeMap::new(), rows: Vec::new() };
        // A profile says all three or none.
        for axis in ["x", "y", "z"] {
            draft.put(&format!("lower_end_mm.{axis}"), 0.0);
        }
        draft
    }

    /// Adds a row about a setting that is not kept.
    pub fn add(&mut self, row: Row) {
        self.rows.push(row);
    }

    /// Says about a setting why not all of it is kept: adds its row, or to its row.
    pub fn note(&mut self, row: Row) {
        match self.row_of(&row).and_then(|index| self.rows.get_mut(index)) {
            Some(other) => other.why = row.why,
            None => self.rows.push(row),
        }
    }

    /// The row of the same setting.
    fn row_of(&self, row: &Row) -> Option<usize> {
        self.rows.iter().position(|other| (&other.file, other.line, &other.key) == (&row.file, row.line, &row.key))
    }

    /// Sets a key, said by a setting: adds its row.
    pub fn keep(&mut self, path: &str, value: impl Into<Value>, row: Row) {
        let value = rounded(value.into());
        let kept = format!("{path} = {value}");
        self.put(path, value);
        let index = self.row_of(&row);
        let kept = match row.kept {
            Some(before) => format!("{before}, {kept}"),
            None => kept,
        };
        match index {
            Some(index) => {
                let other = &mut self.rows[index];
                other.kept = Some(other.kept.take().map_or(kept.clone(), |before| format!("{before}, {kept}")));
                self.set_by.insert(path.to_owned(), index);
            }
            None => {
                self.set_by.insert(path.to_owned(), self.rows.len());
                self.rows.push(Row { kept: Some(kept), ..row });
            }
        }
    }

    /// Sets a key that follows from others.
    pub fn put(&mut self, path: &str, value: impl Into<Value>) {
        set(&mut self.table, path, Some(rounded(value.into())));
    }

    /// A number that is set, or the base's.
    pub fn number(&self, path: &str) -> Option<f64> {
        number(get(&self.table, path)?)
    }

    /// A word that is set, or the base's.
    pub fn word(&self, path: &str) -> Option<&str> {
        get(&self.table, path)?.as_str()
    }

    /// Whether a setting of the file says this key.
    pub fn says(&self, path: &str) -> bool {
        self.set_by.contains_key(path)
    }

    /// Checks the profile. A value that profiles may not have is given up, and its row says why.
    ///
    /// # Errors
    /// The checks refuse what cannot be given up.
    pub fn finish(mut self) -> Result<Imported, ImportError> {
        for _ in 0..MAX_REFUSED {
            let text = toml::to_string(&self.table).map_err(|error| ImportError::Profile(error.to_string()))?;
            let error = match ferrostep_profiles::parse(&text, "profile") {
                Ok(_) => return Ok(self.imported(&text)),
                Err(error) => error,
            };
            let reason = error.problem().to_string();
            let key = error.key().unwrap_or_default().to_owned();
            if !self.give_up(&key, &reason) {
                return Err(ImportError::Profile(reason));
            }
        }
        Err(ImportError::Profile("too many of its values are out of range".to_owned()))
    }

    /// Puts the base's value in the place of a refused one, or removes an optional table; `false` if nothing changes.
    fn give_up(&mut self, key: &str, reason: &str) -> bool {
        // Numbers that are right for an end stop are not for a stall: the sensor is given up, not all of its axis.
        let axis = key.strip_prefix("homing.").filter(|_| reason.contains("stall")).and_then(|rest| rest.get(..1));
        let sensor = axis.map(|axis| format!("homing.{axis}.sensor")).filter(|sensor| self.says(sensor));
        let mut path = sensor.as_deref().unwrap_or(key);
        loop {
            let base = get(&self.base, path).cloned();
            if get(&self.table, path) != base.as_ref() && (base.is_some() || get(&self.table, path).is_some()) {
                set(&mut self.table, path, base);
                let under = format!("{path}.");
                let refused: Vec<usize> = self
                    .set_by
                    .iter()
                    .filter(|(set, _)| *set == path || set.starts_with(&under))
                    .map(|(_, row)| *row)
                    .collect();
                self.set_by.retain(|set, _| set != path && !set.starts_with(&under));
                for (_, row) in self.rows.iter_mut().enumerate().filter(|(index, _)| refused.contains(index)) {
                    row.kept = None;
                    row.why = format!("refused: {reason}");
                }
                return true;
            }
            match path.rsplit_once('.') {
                Some((parent, _)) => path = parent,
                None => return false,
            }
        }
    }

    fn imported(self, text: &str) -> Imported {
        let is_value = |path: &String| get(&self.table, path).is_some_and(|value| !value.is_table());
        // A setting may say a table as a whole.
        let is_said = |path: &String| {
            self.set_by.keys().any(|said| {
                path.strip_prefix(said.as_str()).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            })
        };
        let assumed = paths(&self.table).into_iter().filter(is_value).filter(|path| !is_said(path));
        let assumed = assumed.filter_map(|path| Some(format!("{path} = {}", get(&self.table, &path)?))).collect();
        let mut rows = self.rows;
        rows.sort_by(|a, b| (&a.file, a.line).cmp(&(&b.file, b.line)));
        let head =
            "# Made by `ferrostep import`. Every key, with its range and meaning: the book's page on profiles.\n\n";
        Imported { profile: format!("{head}{text}"), rows, assumed }
    }
}

/// Numbers as people write them: six decimals are more than a profile keeps.
fn rounded(value: Value) -> Value {
    match value {
        Value::Float(number) if number.is_finite() => Value::Float((number * 1e6).round() / 1e6),
        other => other,
    }
}

fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|number| number as f64))
}

fn get<'a>(table: &'a Table, path: &str) -> Option<&'a Value> {
    match path.split_once('.') {
        None => table.get(path),
        Some((first, rest)) => get(table.get(first)?.as_table()?, rest),
    }
}

fn set(table: &mut Table, path: &str, value: Option<Value>) {
    match (path.split_once('.'), value) {
        (None, Some(value)) => {
            table.insert(path.to_owned(), value);
        }
        (None, None) => {
            table.remove(path);
        }
        (Some((first, rest)), value) => {
            let inner = table.entry(first).or_insert_with(|| Value::Table(Table::new()));
            if let Some(inner) = inner.as_table_mut() {
                set(inner, rest, value);
            }
        }
    }
}
