//! The repository as the book may name it: its files, its words, and the items of its code.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Folders with build products or findings, without sources.
const NOT_SOURCES: [&str; 5] = ["target", "artifacts", "corpus", "book", "node_modules"];

/// Ends of names of files whose words count as code.
const CODE: [&str; 8] = [".rs", ".toml", ".lock", ".x", ".json", ".py", ".yml", "/run"];

/// Folder of this test, whose pages and trees are invented.
const MADE_UP: &str = "tests/tests/docs/";

/// Files and code of the repository.
#[derive(Default)]
pub struct Tree {
    /// All paths from the root, folders included.
    paths: BTreeSet<String>,
    /// Sources in Rust, by path.
    sources: BTreeMap<String, String>,
    /// Other texts, by path.
    data: BTreeMap<String, String>,
    /// All identifiers in sources and data.
    words: BTreeSet<String>,
}

impl Tree {
    /// Reads the repository below `root`.
    pub fn read(root: &Path) -> Self {
        let mut tree = Self::default();
        tree.read_folder(root, "");
        tree
    }

    /// Adds a file, as [`Self::read`] does for each.
    pub fn add(&mut self, path: &str, text: &str) {
        self.paths.insert(path.to_owned());
        if is_code(path) {
            let words = text.split(|c: char| !c.is_alphanumeric() && c != '_');
            self.words.extend(words.filter(|word| !word.is_empty()).map(str::to_owned));
        }
        let texts = if path.ends_with(".rs") { &mut self.sources } else { &mut self.data };
        texts.insert(path.to_owned(), text.to_owned());
    }

    fn read_folder(&mut self, folder: &Path, prefix: &str) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            let path = format!("{prefix}{name}");
            if entry.file_type().unwrap().is_dir() {
                if name != ".git" && !NOT_SOURCES.contains(&name.as_str()) {
                    self.paths.insert(path.clone());
                    self.read_folder(&entry.path(), &format!("{path}/"));
                }
            } else {
                let is_read = !path.starts_with(MADE_UP) && (is_code(&path) || path.ends_with(".md"));
                let text = if is_read { std::fs::read(entry.path()).unwrap_or_default() } else { Vec::new() };
                self.add(&path, &String::from_utf8_lossy(&text));
            }
        }
    }

    /// Returns true if a file or folder of this path exists, or may exist where things are built;
    /// `*` means any characters within a name.
    pub fn has_path(&self, path: &str) -> bool {
        let path = path.trim_end_matches('/');
        let is_built = path.split('/').any(|part| NOT_SOURCES.contains(&part));
        is_built
            || self.paths.contains(path)
            || (path.contains('*') && self.paths.iter().any(|candidate| matches(path, candidate)))
    }

    /// Returns true if the first part of a path is a file or folder at the root.
    pub fn is_in_root(&self, path: &str) -> bool {
        path.split_once('/').is_some_and(|(first, _)| self.paths.contains(first))
    }

    /// Returns true if a file ends with this path, as in `look_ahead/runs.rs`.
    pub fn has_file_ending(&self, end: &str) -> bool {
        let end = format!("/{end}");
        self.paths.iter().any(|path| path.ends_with(&end))
    }

    /// Returns true if sources or data contain this word.
    pub fn has_word(&self, word: &str) -> bool {
        self.words.contains(word)
    }

    /// The file's text; empty if it is neither code nor a page.
    pub fn text(&self, path: &str) -> Option<&str> {
        self.sources.get(path).or_else(|| self.data.get(path)).map(String::as_str)
    }

    /// Returns true if `owner` (a type, trait or module) is defined here.
    pub fn defines(&self, owner: &str) -> bool {
        self.sources.iter().any(|(path, text)| is_module(path, owner) || !blocks(text, owner).is_empty())
    }

    /// Returns true if `owner` has an item, field or variant `name`.
    pub fn defines_in(&self, owner: &str, name: &str) -> bool {
        self.sources.iter().any(|(path, text)| {
            (is_module(path, owner) && text.lines().any(|line| is_item(line, name) || is_made_by_macro(line, name)))
                || blocks(text, owner).iter().any(|block| has_member(block, name))
        })
    }
}

fn is_code(path: &str) -> bool {
    CODE.iter().any(|end| path.ends_with(end))
}

/// Returns true if the path is the module's file, or lies in its folder, or in the folder of a
/// crate of that name.
fn is_module(path: &str, module: &str) -> bool {
    let crate_folder = module.strip_prefix("ferrostep_").map(|name| format!("{}/src/", name.replace('_', "-")));
    path.ends_with(&format!("/{module}.rs"))
        || path.contains(&format!("/{module}/"))
        || crate_folder.is_some_and(|folder| path.starts_with(&folder) || path.contains(&format!("/{folder}")))
}

/// Bodies of `struct`, `enum`, `trait`, `mod` and `impl` blocks of `owner`, by the
/// formatter's indentation.
fn blocks<'a>(text: &'a str, owner: &str) -> Vec<&'a str> {
    let mut found = Vec::new();
    let mut place = 0;
    for line in text.split_inclusive('\n') {
        let start = place;
        place += line.len();
        let code = line.trim_start();
        let indent = &line[..line.len() - code.len()];
        if !is_heading_of(code, owner) {
            continue;
        }
        let end = text[start..].find(&format!("\n{indent}}}")).map_or(line.len(), |end| end + 1);
        let is_short = line.trim_end().ends_with(';') || line.trim_end().ends_with('}');
        found.push(&text[start..start + if is_short { line.len() } else { end }]);
    }
    found
}

/// Returns true if a line begins a definition or an implementation of `owner`.
fn is_heading_of(line: &str, owner: &str) -> bool {
    let code = line.strip_prefix("pub").map_or(line, |rest| rest.strip_prefix("(crate)").unwrap_or(rest)).trim_start();
    let mut words = code.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty());
    match words.next() {
        Some("struct" | "enum" | "trait" | "mod" | "union" | "type") => words.next() == Some(owner),
        Some("impl") => words.any(|word| word == owner),
        _ => false,
    }
}

/// Returns true if a block has an item, a field or a variant of this name, one step further in than
/// the block itself.
fn has_member(block: &str, name: &str) -> bool {
    let depth = |line: &str| line.len() - line.trim_start().len();
    let inside = block.lines().next().map_or(0, depth) + 4;
    let holds_items = block.trim_start().starts_with("impl");
    let mut lines = block.lines().skip(1).filter(|line| depth(line) == inside);
    lines.any(|line| is_item(line, name) || (!holds_items && is_name(without(line.trim_start(), "pub"), name)))
}

/// Returns true if a line defines a function, constant, type or module of this name.
fn is_item(line: &str, name: &str) -> bool {
    const BEFORE: [&str; 5] = ["pub", "(crate)", "(super)", "async", "unsafe"];
    let start = BEFORE.iter().fold(line.trim_start(), |rest, word| without(rest, word));
    let after_const = without(start, "const");
    let kinds = ["fn", "struct", "enum", "trait", "mod", "type", "static"];
    let item =
        kinds.iter().find_map(|kind| Some(without(after_const, kind)).filter(|rest| rest.len() < after_const.len()));
    item.map_or(after_const.len() < start.len() && is_name(after_const, name), |item| is_name(item, name))
}

/// Returns true if a line hands this name to a macro that makes items, as `name: value,`.
fn is_made_by_macro(line: &str, name: &str) -> bool {
    line.trim_start().strip_prefix(name).is_some_and(|after| after.starts_with(':') && line.starts_with("    "))
}

/// The line without this word at its start.
fn without<'a>(line: &'a str, word: &str) -> &'a str {
    if is_name(line, word) { line[word.len()..].trim_start() } else { line }
}

/// Returns true if a line starts with this name, as a whole word.
fn is_name(line: &str, name: &str) -> bool {
    line.strip_prefix(name).is_some_and(|after| !after.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
}

/// Returns true if a path fits a pattern, in which `*` means any characters within a name.
fn matches(pattern: &str, path: &str) -> bool {
    let (patterns, parts): (Vec<&str>, Vec<&str>) = (pattern.split('/').collect(), path.split('/').collect());
    patterns.len() == parts.len()
        && patterns.iter().zip(parts).all(|(pattern, part)| match pattern.split_once('*') {
            Some((start, end)) => {
                part.len() >= start.len() + end.len() && part.starts_with(start) && part.ends_with(end)
            }
            None => *pattern == part,
        })
}
