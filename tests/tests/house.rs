//! What manifests switch off is not there: no test and no example is left out without a word.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fs;
use std::path::{Path, PathBuf};

use ferrostep_testkit::program::repository;
use toml::Table;

/// Folders with a manifest, below one.
fn packages(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            if path.join("Cargo.toml").is_file() {
                found.push(path.clone());
            }
            packages(&path, found);
        }
    }
}

/// Rust files below a folder, with their text; those of packages and programs within it left out.
fn sources(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            if !path.join("Cargo.toml").is_file() && !path.ends_with("src/bin") {
                sources(&path, found);
            }
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            found.push((path, text));
        }
    }
}

/// Whether the documentation has an example that rustdoc would compile: a fence without a word, or of Rust.
fn has_example(text: &str) -> bool {
    let mut is_within = false;
    text.lines().filter_map(|line| line.trim_start().strip_prefix("//")?.strip_prefix(['/', '!'])).any(|line| {
        let Some(word) = line.trim().strip_prefix("```") else { return false };
        is_within = !is_within;
        is_within && (word.is_empty() || word.starts_with("rust") || word.starts_with("no_run"))
    })
}

/// The faults of a package.
fn faults(package: &Path) -> Vec<String> {
    let manifest: Table = fs::read_to_string(package.join("Cargo.toml")).unwrap().parse().unwrap();
    let mut faults = Vec::new();
    let mut src = Vec::new();
    sources(&package.join("src"), &mut src);
    let is_off =
        |key: &str| manifest.get("lib").and_then(|lib| lib.get(key)).and_then(toml::Value::as_bool) == Some(false);
    for (path, text) in &src {
        if is_off("doctest") && has_example(text) {
            faults.push(format!("{}: an example, and `doctest = false` in the manifest", path.display()));
        }
        if is_off("test") && (text.contains("#[test]") || text.contains("proptest! {")) {
            faults.push(format!("{}: a test, and `test = false` in the manifest", path.display()));
        }
    }
    if manifest["package"].get("autotests").and_then(toml::Value::as_bool) == Some(false) {
        let tests = package.join("tests");
        let mut modules = Vec::new();
        sources(&tests, &mut modules);
        for (path, _) in modules.iter().filter(|(path, _)| *path != tests.join("main.rs")) {
            let folder = path.parent().unwrap();
            let parent = if folder == tests { tests.join("main.rs") } else { folder.with_extension("rs") };
            let line = format!("mod {};", path.file_stem().unwrap().to_str().unwrap());
            let text = fs::read_to_string(&parent).unwrap_or_default();
            if !text.lines().any(|other| other.trim_start_matches("pub ") == line) {
                faults.push(format!("{}: no module of the tests' program", path.display()));
            }
        }
    }
    faults
}

#[test]
fn nothing_is_left_out_without_a_word() {
    let mut found = Vec::new();
    packages(&repository(), &mut found);
    assert!(found.len() > 30, "{found:?}");
    let faults: Vec<String> = found.iter().flat_map(|package| faults(package)).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn examples_are_told_from_figures() {
    assert!(has_example("/// Adds.\n///\n/// ```\n/// add();\n/// ```\n"));
    assert!(has_example("    //! ```rust\n"));
    assert!(!has_example("/// ```text\n/// a figure\n/// ```\n"));
    assert!(!has_example("fn none() {}\n"));
}
