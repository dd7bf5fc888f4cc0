//! A profile that is being made: values over those of a built-in one.

use std::collections::{BTreeMap, BTreeSet};

use toml::{Table, Value};

use crate::error::ImportError;
use crate::imported::{Gap, Imported, Row};
use crate::nearest::nearest;
use crate::paths::{get, is_identity, number, rounded, set, values};
use crate::rows::Rows;

/// The built-in profile whose values are used for missing ones.
const BASE: &str = "cartesian";

/// Maximum number of values that are changed because the checks of profiles refuse them.
const MAX_REFUSED: usize = 120;

/// Maximum number of moves of a value into its range; if two rules still pull it to and
/// fro, no value fits.
const MAX_MOVES: usize = 3;

/// Tables that go where a value of the machine's identity and they exclude each other,
/// the least first.
const LESSER: [&str; 6] = ["mesh", "input_shaper", "pressure_advance", "bed_screws", "z_motors", "backlash"];

/// A profile that is being made.
pub struct Draft {
    base: Table,
    table: Table,
    /// The rows that set each key, by its path; the last one holds.
    set_by: BTreeMap<String, usize>,
    /// The keys that each row says, with their values.
    sets: BTreeMap<usize, Vec<(String, Value)>>,
    /// Keys whose value the other firmware would have taken by itself.
    own_defaults: BTreeSet<String>,
    rows: Rows,
    gaps: Vec<Gap>,
    unread: Vec<String>,
    substituted: Vec<String>,
    moves: BTreeMap<String, usize>,
}

impl Draft {
    /// Starts a profile without keys.
    pub fn new() -> Self {
        let base: Table = ferrostep_profiles::builtin_text(BASE).and_then(|text| text.parse().ok()).unwrap_or_default();
        let mut draft = Self {
            table: base.clone(),
            base,
            set_by: BTreeMap::new(),
            sets: BTreeMap::new(),
            own_defaults: BTreeSet::new(),
            rows: Rows::default(),
            gaps: Vec::new(),
            unread: Vec::new(),
            substituted: Vec::new(),
            moves: BTreeMap::new(),
        };
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

    /// Records why not all of a setting is kept, in a new row or its present one.
    pub fn note(&mut self, row: Row) {
        match self.rows.find(&row).and_then(|index| self.rows.get_mut(index)) {
            Some(other) => other.why = row.why,
            None => self.add(row),
        }
    }

    /// Notes a part of the machine's identity that the file does not say in a way that can be used:
    /// `what`, of a setting or of none.
    pub fn gap(&mut self, path: &str, row: Option<Row>, what: &str) {
        if self.gaps.iter().any(|gap| gap.path == path) {
            return;
        }
        let place = row.as_ref().map(|row| (row.file.clone(), row.line));
        let what = match &row {
            Some(row) => format!("{} = {}: {what}", row.key, row.value),
            None => what.to_owned(),
        };
        self.gaps.push(Gap { path: path.to_owned(), place, what });
        if let Some(row) = row {
            self.note(row);
        }
    }

    /// Notes a file that could not be read.
    pub fn unread(&mut self, what: String) {
        self.unread.push(what);
    }

    /// Sets a key from a setting, and adds its row.
    pub fn keep(&mut self, path: &str, value: impl Into<Value>, row: Row) {
        let value = rounded(value.into());
        self.put(path, value.clone());
        self.own_defaults.remove(path);
        let index = match self.rows.find(&row) {
            Some(index) => {
                if let Some(other) = self.rows.get_mut(index).filter(|other| other.why.is_empty()) {
                    other.why = row.why;
                }
                index
            }
            None => self.rows.push(row),
        };
        if let Some(row) = self.rows.get_mut(index) {
            row.kept.get_or_insert_with(String::new);
        }
        self.set_by.insert(path.to_owned(), index);
        let said = self.sets.entry(index).or_default();
        said.retain(|(other, _)| other != path);
        said.push((path.to_owned(), value));
    }

    /// Sets a key that follows from others, or that the other firmware has by itself.
    pub fn put(&mut self, path: &str, value: impl Into<Value>) {
        self.own_defaults.insert(path.to_owned());
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

    /// Returns true if a setting of the file sets this key.
    pub fn says(&self, path: &str) -> bool {
        self.set_by.contains_key(path)
    }

    /// Checks the profile. A value that profiles may not have becomes the nearest one that they
    /// may, or is given up, and its row says why.
    ///
    /// # Errors
    /// The machine's identity is missing, or the checks refuse a required value.
    pub fn finish(mut self, assume: bool) -> Result<Imported, ImportError> {
        if !self.gaps.is_empty() && !assume {
            return Err(ImportError::Identity(self.gaps, self.unread));
        }
        for _ in 0..MAX_REFUSED {
            let text = toml::to_string(&self.table).map_err(|error| ImportError::Profile(error.to_string()))?;
            let error = match ferrostep_profiles::parse(&text, "profile") {
                Ok(_) => return Ok(self.imported(&text)),
                Err(error) => error,
            };
            let reason = error.problem().to_string();
            let key = error.key().unwrap_or_default().to_owned();
            if self.move_into_range(&key, &reason) || self.let_lesser_go(&key, &reason) {
                continue;
            }
            let identity = self.identity_of(&key, &reason).or_else(|| self.identity_lost_with(&key));
            if let Some(path) = identity {
                let row = self.set_by.get(&path).and_then(|index| self.rows.get(*index)).cloned();
                self.gap(&path, row, &reason);
                if !assume {
                    return Err(ImportError::Identity(self.gaps, self.unread));
                }
            }
            if !self.give_up(&key, &reason) {
                return Err(ImportError::Profile(reason));
            }
        }
        Err(ImportError::Profile("too many of its values are out of range".to_owned()))
    }

    /// The key of the machine's identity that an error is about, if giving up its key
    /// would change one.
    fn identity_of(&self, key: &str, reason: &str) -> Option<String> {
        // Numbers that are right for an end stop are not for a stall or a probe.
        let axis = key.strip_prefix("homing.").and_then(|rest| rest.split('.').next());
        let of_driver = key.strip_prefix("drivers.").and_then(|rest| rest.split('.').next());
        if let Some(axis) = axis.or(of_driver).filter(|axis| ["x", "y", "z"].contains(axis) && reason.contains("stall"))
        {
            return Some(format!("homing.{axis}.sensor"));
        }
        if ["homing.raise_mm", "homing.home_at_mm", "bltouch"].iter().any(|start| key.starts_with(start))
            && self.word("homing.z.sensor") == Some("probe")
        {
            return Some("homing.z.sensor".to_owned());
        }
        is_identity(key).then(|| key.to_owned())
    }

    /// The key of the machine's identity that goes with the table that giving up a
    /// key would replace.
    fn identity_lost_with(&self, key: &str) -> Option<String> {
        let table = self.given_up_with(key).filter(|path| *path != key)?;
        let under = format!("{table}.");
        let is_lost = |path: &&String| {
            path.starts_with(&under) && is_identity(path) && get(&self.table, path) != get(&self.base, path)
        };
        values(&self.table).iter().find(is_lost).cloned()
    }

    /// The nearest part of the profile around a key that differs from the base's.
    fn given_up_with<'k>(&self, key: &'k str) -> Option<&'k str> {
        let mut path = key;
        loop {
            let (base, now) = (get(&self.base, path), get(&self.table, path));
            if now != base {
                return Some(path);
            }
            path = path.rsplit_once('.')?.0;
        }
    }

    /// Replaces a refused number by the nearest value of its range; `false` if that has no end.
    fn move_into_range(&mut self, key: &str, reason: &str) -> bool {
        if is_identity(key) {
            return false;
        }
        let moves = self.moves.entry(key.to_owned()).or_default();
        *moves += 1;
        if *moves > MAX_MOVES {
            return false;
        }
        let changes = nearest(&self.table, key, reason);
        for (path, value) in &changes {
            self.change(path, Some(value.clone()), reason);
        }
        !changes.is_empty()
    }

    /// Removes the lesser of two keys that exclude each other where the other one is the
    /// machine's identity.
    fn let_lesser_go(&mut self, key: &str, reason: &str) -> bool {
        if !is_identity(key) {
            return false;
        }
        let is_there = |name: &&str| get(&self.table, name).is_some();
        let there: Vec<&str> = LESSER.into_iter().filter(is_there).collect();
        let alone = there.iter().map(|name| vec![*name]);
        for goes in alone.chain([there.clone()]) {
            let mut without = self.table.clone();
            for name in &goes {
                set(&mut without, name, None);
            }
            let error = toml::to_string(&without).ok().map(|text| ferrostep_profiles::parse(&text, "profile").err());
            let is_cured = error.is_some_and(|error| error.is_none_or(|error| error.key() != Some(key)));
            if is_cured {
                for name in goes {
                    let why = format!("{name} goes, for the machine's {key} stays: {reason}");
                    self.change(name, None, &why);
                }
                return true;
            }
        }
        false
    }

    /// Replaces a refused value by the base's, or removes an optional table; `false` if
    /// nothing changes.
    fn give_up(&mut self, key: &str, reason: &str) -> bool {
        let identity = self.identity_of(key, reason);
        let Some(path) = self.given_up_with(identity.as_deref().unwrap_or(key)).map(str::to_owned) else {
            return false;
        };
        let base = get(&self.base, &path).cloned();
        self.change(&path, base, reason);
        true
    }

    /// Sets or removes a key that a check refused, and reports it in the key's rows. The
    /// first reason of a row stays.
    fn change(&mut self, path: &str, value: Option<Value>, reason: &str) {
        let before = get(&self.table, path).cloned();
        set(&mut self.table, path, value.clone());
        let under = format!("{path}.");
        let is_meant = |said: &String| said == path || said.starts_with(&under);
        let rows: BTreeSet<usize> =
            self.set_by.iter().filter(|(said, _)| is_meant(said)).map(|(_, index)| *index).collect();
        let instead = match &value {
            Some(value) if !value.is_table() => format!("{path} = {value} is written"),
            Some(_) => format!("another {path} is written"),
            None => format!("{path} is left out"),
        };
        for index in &rows {
            if let Some(row) = self.rows.get_mut(*index)
                && !row.refused
            {
                row.refused = true;
                row.why = format!("refused: {reason}: {instead}");
            }
        }
        if !rows.is_empty() || before.as_ref().is_some_and(|before| !before.is_table()) {
            self.substituted.push(instead);
        }
    }

    fn imported(mut self, text: &str) -> Imported {
        self.check_rows();
        // A setting may say a table as a whole.
        let is_said = |path: &String| {
            self.set_by.keys().any(|said| {
                path.strip_prefix(said.as_str()).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            })
        };
        let shown = |path: &String| Some(format!("{path} = {}", get(&self.table, path)?));
        let not_said: Vec<String> = values(&self.table).into_iter().filter(|path| !is_said(path)).collect();
        let assumed: Vec<String> = not_said.iter().filter_map(shown).collect();
        let is_built_in = |path: &&String| !self.own_defaults.contains(*path) && get(&self.base, path).is_some();
        let built_in: Vec<String> = not_said.iter().filter(is_built_in).filter_map(shown).collect();
        let homing = |path: &&String| path.starts_with("homing.") || path.contains("sensor") || is_identity(path);
        let homing: Vec<String> = not_said.iter().filter(homing).filter_map(shown).collect();
        let rows = self.rows.into_sorted();
        let by_permission = self.gaps.iter().map(ToString::to_string).collect();
        let mut substituted = self.substituted;
        substituted.dedup();
        let profile = crate::mark::marked(text);
        Imported { profile, rows, assumed, unread: self.unread, by_permission, substituted, homing, built_in }
    }

    /// Updates the rows to the profile: each kept key with the profile's value.
    fn check_rows(&mut self) {
        for (index, said) in &self.sets {
            let Some(row) = self.rows.get_mut(*index) else { continue };
            let mut kept: Vec<String> = Vec::new();
            for (path, value) in said {
                let Some(now) = get(&self.table, path) else { continue };
                if now == value {
                    kept.push(shown(path, now));
                } else if self.set_by.get(path) == Some(index) && row.refused {
                    // Moved into its range: the reason says so.
                    if number(now).is_some() || now.is_array() {
                        kept.push(shown(path, now));
                    }
                } else if row.why.is_empty() {
                    row.why = format!("another line sets {path}");
                }
            }
            if kept.is_empty() && row.why.is_empty() {
                row.why = "not in the profile: another line holds".to_owned();
            }
            row.kept = (!kept.is_empty()).then(|| kept.join(", "));
        }
    }
}

/// A key with its value, on one line; a table without spaces, as one value.
fn shown(path: &str, value: &Value) -> String {
    let text = match value {
        Value::Table(_) => value.to_string().replace(" = ", "=").replace(", ", ","),
        Value::String(lines) if lines.contains('\n') => format!("{:?}", lines.trim()),
        other => other.to_string(),
    };
    format!("{path} = {text}")
}
