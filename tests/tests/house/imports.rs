//! Imports between the files of a package.
//!
//! `use` lines and paths that begin with `crate::` or `super::` are read. A name that a file passes
//! on (`pub use`) counts as that of the file which defines it. Modules of tests are left out.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::sources;

/// A module's path below the package: of `src/heat/model.rs` it is `heat`, `model`, of
/// `src/lib.rs` nothing.
type Module = Vec<String>;

/// The files of a package's library, or of its program where it has no library.
pub struct Imports {
    /// Texts of the files, without comments and tests.
    texts: BTreeMap<Module, String>,
    /// Names that the modules pass on, and their origins.
    passed_on: BTreeMap<(Module, String), Vec<String>>,
}

/// A module's file, without `.rs`; the package's root, which in a program is `main.rs`, is `lib`.
fn named(module: &Module) -> String {
    if module.is_empty() { "lib".to_owned() } else { module.join("/") }
}

/// The segments of a path.
fn segments(path: &str) -> impl Iterator<Item = String> {
    path.split("::").map(|segment| segment.trim().to_owned()).filter(|segment| !segment.is_empty())
}

/// The paths of a `use` tree, each with the name that it has from then on.
fn leaves(tree: &str, before: &[String], found: &mut Vec<(Vec<String>, String)>) {
    let tree = tree.trim();
    if let Some((start, rest)) = tree.split_once('{') {
        let before: Vec<String> = before.iter().cloned().chain(segments(start)).collect();
        let mut depth = 0;
        let inner = rest.trim_end().strip_suffix('}').unwrap_or(rest);
        let parts = inner.split(|letter| {
            depth += i32::from(letter == '{') - i32::from(letter == '}');
            letter == ',' && depth == 0
        });
        parts.filter(|part| !part.trim().is_empty()).for_each(|part| leaves(part, &before, found));
    } else {
        let (path, name) = tree.split_once(" as ").map_or((tree, None), |(path, name)| (path, Some(name.trim())));
        let mut path: Vec<String> = before.iter().cloned().chain(segments(path)).collect();
        path.pop_if(|last| last == "self" && !before.is_empty());
        if let Some(name) = name.map(str::to_owned).or_else(|| path.last().cloned()) {
            found.push((path, name));
        }
    }
}

/// A text without comments and without the code of tests; and the names of the modules of tests.
fn without_tests(text: &str) -> (String, Vec<String>) {
    let (mut kept, mut modules) = (String::new(), Vec::new());
    let mut lines = text.lines().map(|line| line.split_once("//").map_or(line, |(code, _)| code));
    while let Some(line) = lines.next() {
        let (indent, code) = line.split_at(line.len() - line.trim_start().len());
        if code != "#[cfg(test)]" {
            kept.push_str(line);
            kept.push('\n');
            continue;
        }
        let Some(item) = lines.by_ref().find(|line| !line.trim_start().starts_with("#[")) else { break };
        if let Some((_, name)) = item.split_once("mod ") {
            modules.push(name.trim_end_matches([';', '{', ' ', '}']).to_owned());
        }
        if !item.ends_with([';', '}']) {
            let _end = lines.by_ref().find(|line| line.strip_prefix(indent).is_some_and(|line| line.starts_with('}')));
        }
    }
    (kept, modules)
}

/// The `use` lines of a text, each with true if it passes on its names; and the text without them.
fn uses(text: &str) -> (Vec<(String, bool)>, String) {
    let (mut found, mut rest) = (Vec::new(), String::new());
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let trimmed = line.trim_start();
        let is_public = trimmed.starts_with("pub");
        let start = if is_public { trimmed.split_once(' ').map_or("", |(_, start)| start) } else { trimmed };
        let Some(tree) = start.strip_prefix("use ") else {
            rest.push_str(line);
            rest.push('\n');
            continue;
        };
        let mut tree = tree.to_owned();
        while !tree.ends_with(';') {
            let Some(next) = lines.next() else { break };
            tree.push_str(next.trim());
        }
        found.push((tree.trim_end_matches(';').to_owned(), is_public));
    }
    (found, rest)
}

/// The paths in code that begin with `crate::` or `super::`.
fn paths(code: &str) -> Vec<Vec<String>> {
    let is_of_path = |letter: char| letter.is_alphanumeric() || letter == '_' || letter == ':';
    let all = code.split(|letter: char| !is_of_path(letter));
    all.filter(|path| path.starts_with("crate::") || path.starts_with("super::"))
        .map(|path| segments(path).collect())
        .collect()
}

impl Imports {
    /// Reads the imports of the package in a folder.
    pub fn of(package: &Path) -> Self {
        let src = package.join("src");
        let mut files = Vec::new();
        sources(&src, &mut files);
        let files = files.into_iter().map(|(path, text)| {
            let inner = path.strip_prefix(&src).unwrap().with_extension("");
            (inner.iter().map(|part| part.to_str().unwrap().to_owned()).collect(), text)
        });
        Self::of_texts(files.collect())
    }

    /// Reads the imports of these files, given by their paths without `.rs`.
    fn of_texts(files: Vec<(Module, String)>) -> Self {
        let (mut texts, mut of_tests) = (BTreeMap::new(), Vec::new());
        let root = if files.iter().any(|(module, _)| module == &["lib"]) { "lib" } else { "main" };
        for (mut module, text) in files {
            module.pop_if(|name| name == "mod");
            if module == [root] {
                module.clear();
            } else if module == ["main"] {
                continue;
            }
            let (text, tests) = without_tests(&text);
            of_tests.extend(tests.into_iter().map(|name| [module.clone(), vec![name]].concat()));
            texts.insert(module, text);
        }
        texts.retain(|module, _| !of_tests.iter().any(|tests| module.starts_with(tests)));
        let mut passed_on = BTreeMap::new();
        for (module, text) in &texts {
            for (tree, _) in uses(text).0.into_iter().filter(|(_, is_public)| *is_public) {
                let mut found = Vec::new();
                leaves(&tree, &[], &mut found);
                passed_on.extend(found.into_iter().map(|(path, name)| ((module.clone(), name), path)));
            }
        }
        Self { texts, passed_on }
    }

    /// The file that a path leads to from a file; `None` for other packages.
    fn target(&self, from: &Module, path: &[String], passed: usize) -> Option<Module> {
        let (first, mut rest) = path.split_first()?;
        let mut at = match first.as_str() {
            "crate" => Vec::new(),
            "self" => from.clone(),
            "super" => from.split_last()?.1.to_vec(),
            _ => {
                rest = path;
                if !self.texts.contains_key(&[from.clone(), vec![first.clone()]].concat()) {
                    return None;
                }
                from.clone()
            }
        };
        while let Some((next, further)) = rest.split_first() {
            if next == "super" {
                at.pop()?;
            } else {
                let below = [at.clone(), vec![next.clone()]].concat();
                if !self.texts.contains_key(&below) {
                    break;
                }
                at = below;
            }
            rest = further;
        }
        let name = rest.first().map(|name| (at.clone(), name.clone()));
        let origin = name.and_then(|name| self.passed_on.get(&name)).filter(|_| passed < 8);
        origin.and_then(|origin| self.target(&at, origin, passed + 1)).or(Some(at))
    }

    /// The files that a file imports from.
    fn imported(&self, from: &Module, text: &str) -> BTreeSet<Module> {
        let (uses, code) = uses(text);
        let mut found = Vec::new();
        uses.iter().for_each(|(tree, _)| leaves(tree, &[], &mut found));
        let all = found.into_iter().map(|(path, _)| path).chain(paths(&code));
        all.filter_map(|path| self.target(from, &path, 0)).filter(|to| to != from).collect()
    }

    /// The files that import from a module of the top level, or from below it, and do not lie
    /// there themselves.
    pub fn importers(&self, of: &str) -> Vec<String> {
        let is_there = |module: &Module| module.first().is_some_and(|first| first == of);
        let imports = |(module, text): &(&Module, &String)| self.imported(module, text).iter().any(is_there);
        let others = self.texts.iter().filter(|(module, _)| !is_there(module));
        others.filter(imports).map(|(module, _)| named(module)).collect()
    }

    /// The circles of more than two files: each imports, directly or through others, from each of
    /// the same circle.
    pub fn circles(&self) -> Vec<Vec<String>> {
        let arrows: BTreeMap<&Module, BTreeSet<Module>> =
            self.texts.iter().map(|(module, text)| (module, self.imported(module, text))).collect();
        let reached = |from: &Module| {
            let (mut reached, mut next) = (BTreeSet::new(), vec![from.clone()]);
            while let Some(module) = next.pop() {
                let new = arrows.get(&module).into_iter().flatten().filter(|to| reached.insert((*to).clone()));
                next.extend(new.cloned().collect::<Vec<_>>());
            }
            reached
        };
        let reached: BTreeMap<&Module, BTreeSet<Module>> =
            self.texts.keys().map(|module| (module, reached(module))).collect();
        let circle = |module: &Module| -> Vec<String> {
            let round = reached[module].iter().filter(|other| reached[other].contains(module));
            round.map(named).collect()
        };
        let circles: BTreeSet<Vec<String>> = self.texts.keys().map(circle).filter(|circle| circle.len() > 2).collect();
        circles.into_iter().collect()
    }
}

#[test]
fn circles_of_a_program_are_found() {
    let files = [
        ("main", "mod a;\nmod b;\nuse a::One;\nfn shared() {}\n"),
        ("a", "use crate::b::Two;\n"),
        ("b", "fn of() { crate::shared() }\n"),
    ];
    let files = files.map(|(path, text)| (vec![path.to_owned()], text.to_owned()));
    assert_eq!(Imports::of_texts(files.to_vec()).circles(), [["lib", "a", "b"]]);
}

#[test]
fn circles_are_found_through_lists_aliases_and_names_passed_on() {
    let files = [
        ("lib", "mod a;\nmod b;\nmod c;\nmod d;\npub use c::Thing;\n"),
        ("a", "use crate::b::{self, Inner as Other};\n"),
        ("b", "// use crate::d::Nothing;\nfn of() -> crate::Thing { todo!() }\n"),
        ("c", "use super::{\n    a::One,\n    d::Two,\n};\n"),
        ("d", "use std::fmt;\n#[cfg(test)]\nmod tests {\n    use crate::a::One;\n}\n"),
    ];
    let imports = |files: &[(&str, &str)]| {
        let files = files.iter().map(|(path, text)| (path.split('/').map(str::to_owned).collect(), (*text).to_owned()));
        Imports::of_texts(files.collect())
    };
    assert_eq!(imports(&files).circles(), [["a", "b", "c"]]);
    assert_eq!(imports(&files).importers("c"), ["lib", "b"]);
    assert_eq!(imports(&files).importers("d"), ["c"]);
    assert!(imports(&files[..3]).circles().is_empty());
}
