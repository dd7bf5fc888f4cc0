//! Every file, item, page and anchor that the book and the README name exists.

use std::path::Path;

use super::page::Page;
use super::tree::Tree;

/// Crates of others whose items the book names.
const FOREIGN: [&str; 6] = ["std", "core", "alloc", "cortex_m", "rtic_sync", "rtic_time"];

/// Words in code spans that look like Ferrostep's names and are not.
const NOT_OURS: [&str; 0] = [];

/// A stale name.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Stale {
    page: String,
    line: usize,
    name: String,
    why: &'static str,
}

fn stale(pages: &[Page], tree: &Tree) -> Vec<Stale> {
    let mut found = Vec::new();
    for page in pages {
        let mut report = |line: usize, name: &str, why: Option<&'static str>| {
            found.extend(why.map(|why| Stale { page: page.path.clone(), line, name: name.to_owned(), why }));
        };
        let spans = page.code_spans();
        for span in &spans {
            let same_line = spans.iter().filter(|other| other.line == span.line).map(|other| other.text);
            let wrong = wrong_with_name(span.text, tree).or_else(|| wrong_beside(span.text, same_line, tree));
            report(span.line, span.text, wrong);
        }
        for word in page.block_words() {
            report(word.line, word.text, wrong_with_path(word.text, tree));
        }
        for link in page.links() {
            report(link.line, link.text, wrong_with_link(page, link.text, pages, tree));
        }
        for include in page.includes() {
            report(include.line, include.text, wrong_with_include(page, include.text, tree));
        }
    }
    found.sort();
    found
}

fn wrong_with_name(span: &str, tree: &Tree) -> Option<&'static str> {
    if let Some((file, item)) = span.split_once(".rs::") {
        return wrong_with_item_of_file(&format!("{file}.rs"), item, tree);
    }
    if span.contains('/') {
        return span.split_whitespace().find_map(|word| wrong_with_path(word, tree));
    }
    let name = span.trim_end_matches("()");
    if !name.starts_with(char::is_alphabetic) || name.contains(|c: char| !c.is_alphanumeric() && !"_:.".contains(c)) {
        return None;
    }
    if let Some((owners, item)) = name.rsplit_once("::") {
        let owner = owners.rsplit("::").next().unwrap_or(owners);
        let first = owners.split("::").next().unwrap_or(owners);
        return match () {
            () if FOREIGN.contains(&first) => None,
            () if !tree.defines(owner) => Some("no such type or module"),
            () if !tree.defines_in(owner, item) => Some("the type or module has no such item"),
            () => None,
        };
    }
    if name.ends_with(".rs") {
        return (!tree.has_file_ending(name)).then_some("no such file");
    }
    let is_camel = name.chars().skip(1).any(char::is_uppercase)
        && name.chars().any(char::is_lowercase)
        && name.starts_with(char::is_uppercase);
    let is_snake = name.contains('_') && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
    let is_ours = (is_camel || is_snake) && !name.contains(['.', ':']) && !NOT_OURS.contains(&name);
    (is_ours && !tree.has_word(name)).then_some("no such name in the code")
}

/// A file named without its folder, after a whole path in the same line, lies beside it:
/// "`planner/src/path.rs`, `pace.rs`".
fn wrong_beside<'a>(name: &str, same_line: impl Iterator<Item = &'a str>, tree: &Tree) -> Option<&'static str> {
    if name.contains(['/', ':']) || !name.ends_with(".rs") {
        return None;
    }
    let mut folders = same_line.filter(|path| path.ends_with(".rs") && tree.is_in_root(path)).peekable();
    folders.peek()?;
    let lies_beside = folders.any(|path| tree.has_path(&beside(path, name)));
    (!lies_beside).then_some("no such file beside those in the same line")
}

fn wrong_with_item_of_file(file: &str, item: &str, tree: &Tree) -> Option<&'static str> {
    match tree.text(file) {
        None => Some("no such file"),
        Some(text) if !text.contains(&format!("fn {item}(")) => Some("the file has no such function"),
        Some(_) => None,
    }
}

/// A word counts as a path if it begins with a folder of the repository or ends in `.rs`.
fn wrong_with_path(word: &str, tree: &Tree) -> Option<&'static str> {
    let word = word.trim_matches(|c: char| !c.is_alphanumeric() && !"./*_".contains(c)).trim_end_matches(['.', ':']);
    let path = word.split_once(".rs:").map_or_else(|| word.to_owned(), |(file, _)| format!("{file}.rs"));
    let path = path.split_once('=').map_or(path.as_str(), |(_, value)| value);
    let has_placeholder = path.split('/').any(|part| part.len() > 1 && part.chars().all(|c| c.is_ascii_uppercase()));
    if has_placeholder || path.contains("://") {
        return None;
    }
    if tree.is_in_root(path) {
        return (!tree.has_path(path)).then_some("no such file or folder");
    }
    (path.ends_with(".rs") && !tree.has_file_ending(path)).then_some("no such file")
}

fn wrong_with_link(page: &Page, target: &str, pages: &[Page], tree: &Tree) -> Option<&'static str> {
    if target.contains("://") || target.starts_with("mailto:") {
        return None;
    }
    let (file, anchor) = target.split_once('#').map_or((target, None), |(file, anchor)| (file, Some(anchor)));
    let path = if file.is_empty() { page.path.clone() } else { beside(&page.path, file) };
    if !tree.has_path(&path) {
        return Some("no such page or file");
    }
    let anchors = pages.iter().find(|other| other.path == path)?.anchors();
    anchor.filter(|anchor| !anchors.iter().any(|known| known == anchor)).map(|_| "the page has no such heading")
}

fn wrong_with_include(page: &Page, target: &str, tree: &Tree) -> Option<&'static str> {
    let (file, anchor) = target.split_once(':').unwrap_or((target, ""));
    let path = beside(&page.path, file);
    match tree.text(&path) {
        None => Some("no such file"),
        Some(text) if anchor.is_empty() || has_anchor(text, anchor) => None,
        Some(_) => Some("the file has no such anchor"),
    }
}

/// Returns true if a comment of the file marks the start of this anchor, as mdBook reads it.
fn has_anchor(text: &str, anchor: &str) -> bool {
    let mut marks = text.split("ANCHOR: ").skip(1);
    marks.any(|mark| mark.split_whitespace().next() == Some(anchor))
}

/// The path from the root of what a page calls `file`.
fn beside(page: &str, file: &str) -> String {
    let mut parts: Vec<&str> = page.split('/').collect();
    parts.pop();
    for part in file.split('/') {
        match part {
            ".." => drop(parts.pop()),
            "." => {}
            _ => parts.push(part),
        }
    }
    parts.join("/")
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// The book and the pages beside it; the changelog may name removed things.
fn pages() -> Vec<Page> {
    let mut paths = ["README.md", "CONTRIBUTING.md", "SECURITY.md", "examples/README.md", "tests/fuzz/README.md"]
        .map(str::to_owned)
        .to_vec();
    let mut folders = vec!["docs/src".to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(root().join(&folder)).unwrap() {
            let entry = entry.unwrap();
            let path = format!("{folder}/{}", entry.file_name().to_str().unwrap());
            match entry.file_type().unwrap().is_dir() {
                true => folders.push(path),
                false if path.ends_with(".md") => paths.push(path),
                false => {}
            }
        }
    }
    paths.into_iter().map(|path| Page { text: std::fs::read_to_string(root().join(&path)).unwrap(), path }).collect()
}

#[test]
fn everything_that_the_book_names_exists() {
    let stale = stale(&pages(), &Tree::read(root()));
    let lines: Vec<String> =
        stale.iter().map(|stale| format!("{}:{}: {}: {}", stale.page, stale.line, stale.name, stale.why)).collect();
    assert!(lines.is_empty(), "{} names lead nowhere:\n{}", lines.len(), lines.join("\n"));
}

#[test]
fn every_page_is_in_the_summary_once() {
    let pages = pages();
    let summary = pages.iter().find(|page| page.path == "docs/src/SUMMARY.md").unwrap();
    let mut listed: Vec<String> = summary.links().iter().map(|link| beside(&summary.path, link.text)).collect();
    let mut written: Vec<String> = pages
        .iter()
        .map(|page| page.path.clone())
        .filter(|path| path.starts_with("docs/src/") && *path != summary.path)
        .collect();
    listed.sort();
    written.sort();
    assert_eq!(listed, written);
}

/// A tree with one of each thing that a page can name.
fn small_tree() -> Tree {
    let mut tree = Tree::default();
    for folder in ["docs", "docs/src", "planner", "planner/src"] {
        tree.add(folder, "");
    }
    tree.add("docs/src/page.md", "");
    tree.add("printer/src/other.rs", "");
    tree.add(
        "planner/src/ring.rs",
        "// ANCHOR: ring\n/// A ring.\npub struct Ring {\n    pub free_slots: u32,\n}\n// ANCHOR_END: ring\n\
         \nimpl Ring {\n    /// Adds.\n    pub const fn push(&mut self) {}\n}\n\npub enum Law {\n    Ramp,\n}\n\
         \nfn a_test() {}\n\nfn pop() {}\n",
    );
    tree
}

fn stale_in(text: &str) -> Vec<(usize, String, &'static str)> {
    let page = Page { path: "docs/src/page.md".to_owned(), text: text.to_owned() };
    stale(&[page], &small_tree()).into_iter().map(|stale| (stale.line, stale.name, stale.why)).collect()
}

#[test]
fn names_that_exist_pass() {
    let text = "# One heading: it's `Ring`\n\n`planner/src/ring.rs`, `ring.rs`, `planner/src/*.rs`, `Ring::push()`, `Law::Ramp`,\n\
        `Ring::free_slots`, `free_slots`, `ring::pop`, `planner/src/ring.rs::a_test`, `std::mem::swap`\n\
        [here](#one-heading-its-ring) [there](page.md) [away](https://example.com/none.md)\n\
        \n    cat planner/src/ring.rs my/own/file\n\n```rust\n{{#include ../../planner/src/ring.rs:ring}}\n```\n";
    assert_eq!(stale_in(text), []);
}

#[test]
fn each_stale_name_is_reported_with_its_line() {
    let cases = [
        ("`planner/src/gone.rs`", "planner/src/gone.rs", "no such file or folder"),
        ("`planner/src/*.toml`", "planner/src/*.toml", "no such file or folder"),
        ("`gone.rs`", "gone.rs", "no such file"),
        ("`look/ring.rs`", "look/ring.rs", "no such file"),
        ("`planner/src/ring.rs`, `other.rs`", "other.rs", "no such file beside those in the same line"),
        ("`planner/src/ring.rs::no_test`", "planner/src/ring.rs::no_test", "the file has no such function"),
        ("`planner/src/gone.rs::a_test`", "planner/src/gone.rs::a_test", "no such file"),
        ("`Queue::push`", "Queue::push", "no such type or module"),
        ("`Ring::pop`", "Ring::pop", "the type or module has no such item"),
        ("`Law::Curve`", "Law::Curve", "the type or module has no such item"),
        ("`StepQueue`", "StepQueue", "no such name in the code"),
        ("`used_slots`", "used_slots", "no such name in the code"),
        ("[there](gone.md)", "gone.md", "no such page or file"),
        ("[there](#gone)", "#gone", "the page has no such heading"),
        ("    cat planner/gone.rs", "planner/gone.rs", "no such file or folder"),
        (
            "{{#include ../../planner/src/ring.rs:gone}}",
            "../../planner/src/ring.rs:gone",
            "the file has no such anchor",
        ),
        ("{{#include ../../gone.rs}}", "../../gone.rs", "no such file"),
    ];
    for (text, name, why) in cases {
        assert_eq!(stale_in(&format!("# Page\n\n{text}\n")), [(3, name.to_owned(), why)]);
    }
}
