//! The keys of a kind of file, and the book's table of them.

use std::fmt::Write;

/// A key as it was declared.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Key {
    /// The key's name in its table.
    pub name: &'static str,
    /// Full path.
    pub path: String,
    /// True if it names a table with its own keys.
    pub is_section: bool,
    /// Names of the keys in a table that counts as one value, such as `x`, `y`, `z`.
    pub names: Vec<&'static str>,
    /// Unit in words; empty for a plain number and for words.
    pub unit: &'static str,
    /// The right values, for a book.
    pub allowed: String,
    /// The key's effect when it is left out; empty for a required key.
    pub absent: String,
    /// The key's meaning, for a book.
    pub about: &'static str,
    /// Two files that differ in it do not count as the same.
    pub is_bound: bool,
}

/// The keys of a kind of file, in the order in which they are read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    keys: Vec<Key>,
}

/// Tables of the same keys, such as `homing.x` and `homing.y`, or one key, or the same key
/// of those tables.
struct Row<'a> {
    same: Vec<&'a Key>,
    depth: usize,
    inner: Vec<Row<'a>>,
}

impl Schema {
    pub(crate) fn new(keys: Vec<Key>) -> Self {
        Self { keys }
    }

    /// All keys.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// A Markdown table: key (● after it: [bound](Key::is_bound)), unit, right values, default, and
    /// meaning.
    ///
    /// Tables of the same keys, and values with the same texts, share their lines where one follows
    /// the other. The first table of a pair in `alike` has one line, which refers to the second.
    pub fn markdown(&self, alike: &[(&str, &str)]) -> String {
        let mut text = "| key | unit | value | if left out | meaning |\n|---|---|---|---|---|\n".to_owned();
        for row in rows(&self.keys.iter().collect::<Vec<_>>(), "", 0) {
            row.write(&mut text, alike);
        }
        text
    }
}

/// The keys of one table; those of equal tables are merged, and keys with the same texts.
fn rows<'a>(keys: &[&'a Key], table: &str, depth: usize) -> Vec<Row<'a>> {
    let parent = |key: &Key| key.path.rsplit_once('.').map_or("", |(parent, _)| parent).to_owned();
    let mut rows: Vec<Row<'a>> = Vec::new();
    for key in keys.iter().filter(|key| parent(key) == table) {
        let inner = self::rows(keys, &key.path, depth + 1);
        match rows.last_mut() {
            Some(before) if before.is_shared_by(key, &inner) => before.merge(key, inner),
            _ => rows.push(Row { same: vec![key], depth, inner }),
        }
    }
    rows
}

/// Names of all keys, those of tables within included.
fn paths(rows: &[Row<'_>]) -> Vec<&'static str> {
    rows.iter().flat_map(|row| row.names().into_iter().chain(paths(&row.inner))).collect()
}

impl<'a> Row<'a> {
    /// True for a table of the same keys as the one before, and a value with the same texts.
    fn is_shared_by(&self, key: &Key, inner: &[Row<'_>]) -> bool {
        if !inner.is_empty() {
            return paths(&self.inner) == paths(inner);
        }
        let texts = |key: &Key| (key.unit, key.allowed.clone(), key.absent.clone(), key.about, key.is_bound);
        let last = self.same.last().filter(|last| last.names.is_empty() && key.names.is_empty());
        self.inner.is_empty() && last.is_some_and(|last| texts(last) == texts(key))
    }

    /// Names of the keys, each once.
    fn names(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        for key in &self.same {
            if !names.contains(&key.name) {
                names.push(key.name);
            }
        }
        names
    }

    fn merge(&mut self, key: &'a Key, inner: Vec<Row<'a>>) {
        self.same.push(key);
        for (mine, other) in self.inner.iter_mut().zip(inner) {
            mine.absorb(other);
        }
    }

    fn absorb(&mut self, other: Row<'a>) {
        self.same.extend(other.same);
        for (mine, other) in self.inner.iter_mut().zip(other.inner) {
            mine.absorb(other);
        }
    }

    fn write(&self, text: &mut String, alike: &[(&str, &str)]) {
        let Some(first) = self.same.first() else { return };
        let other = alike.iter().find(|(table, _)| *table == first.path).map(|(_, other)| other);
        let keys_as = other.map_or_else(String::new, |other| format!("keys as in `{other}`; "));
        let dashes = "– ".repeat(self.depth);
        let mut name = self.names().iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        if !first.names.is_empty() {
            let _ = write!(name, " `{}`", first.names.join(" "));
        }
        let cell = |of: fn(&Key) -> String| self.cell(of);
        let is_bound = cell(|key| if key.is_bound && !key.is_section { " ●".to_owned() } else { String::new() });
        let _ = writeln!(
            text,
            "| {dashes}{name}{}{is_bound} | {} | {} | {} | {keys_as}{} |",
            if first.is_section { ":" } else { "" },
            cell(|key| book_unit(key.unit)),
            cell(|key| key.allowed.clone()),
            cell(|key| key.absent.clone()),
            cell(|key| key.about.to_owned()),
        );
        if other.is_none() {
            self.inner.iter().for_each(|row| row.write(text, alike));
        }
    }

    /// The text that all rows share, or each row's text.
    fn cell(&self, of: fn(&Key) -> String) -> String {
        let all: Vec<String> = self.same.iter().map(|key| of(key)).collect();
        if all.windows(2).all(|pair| pair[0] == pair[1]) {
            return all.into_iter().next().unwrap_or_default();
        }
        let paths: Vec<Vec<&str>> = self.same.iter().map(|key| key.path.split('.').collect()).collect();
        let differing =
            (0..).find(|at| paths.iter().any(|path| path.get(*at) != paths[0].get(*at))).unwrap_or_default();
        let mut groups: Vec<(Vec<&str>, String)> = Vec::new();
        for (path, value) in paths.iter().zip(all).filter(|(_, value)| !value.is_empty()) {
            let table = path.get(differing).copied().unwrap_or_default();
            match groups.iter_mut().find(|(_, other)| *other == value) {
                Some((tables, _)) if tables.contains(&table) => {}
                Some((tables, _)) => tables.push(table),
                None => groups.push((vec![table], value)),
            }
        }
        groups.iter().map(|(tables, value)| format!("{}: {value}", tables.join(", "))).collect::<Vec<_>>().join("; ")
    }
}

/// A unit by its sign.
fn book_unit(unit: &str) -> String {
    let signs =
        [("degrees Celsius", "°C"), ("degrees", "K"), ("ohms", "Ω"), ("ohm", "Ω"), ("us", "µs"), ("percent", "%")];
    let sign = signs.iter().find(|(words, _)| *words == unit).map_or(unit, |(_, sign)| *sign);
    sign.replace("^2", "²").replace("^3", "³")
}
