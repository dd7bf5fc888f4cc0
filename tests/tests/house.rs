//! The house: which folder uses which, which file imports which, and nothing that manifests switch
//! off without a word.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod imports;

use std::fs;
use std::path::{Path, PathBuf};

use ferrostep_testkit::program::repository;
use toml::Table;

use imports::Imports;

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

/// Returns true if the documentation has an example that rustdoc would compile: a fence without a
/// word, or of Rust.
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

/// Folders of the top level that packages of a folder may use, beside their own. `tests` and
/// `xtask` may use all.
const USES: [(&str, &[&str]); 7] = [
    ("planner", &[]),
    ("hal-shim", &["planner"]),
    ("printer", &["planner", "hal-shim"]),
    ("config", &["planner", "hal-shim", "printer"]),
    ("papers", &["planner"]),
    ("app", &["planner", "hal-shim", "printer", "config", "papers"]),
    ("desk", &["planner", "hal-shim", "printer", "config", "papers"]),
];

/// Arrows that break the rule. The list may only become shorter.
const AGAINST_THE_RULE: [(&str, &str); 8] = [
    ("desk/analysis", "tests/oracle"),
    ("desk/simulator", "tests/oracle"),
    ("hal-shim/stm32f4-board", "config/boards"),
    ("hal-shim/stm32f4-board", "printer/black-box"),
    ("hal-shim/stm32f4-usb", "printer/gcode"),
    ("hal-shim/stm32f4-usb", "printer/host-port"),
    ("papers", "printer"),
    ("papers", "printer/gpre"),
];

/// The folders of Ferrostep's packages that a package's library or build script uses, by the
/// workspace's names.
fn used(package: &Path, of_workspace: &Table) -> Vec<PathBuf> {
    let manifest: Table = fs::read_to_string(package.join("Cargo.toml")).unwrap().parse().unwrap();
    let tables =
        ["dependencies", "build-dependencies"].map(|table| manifest.get(table).and_then(toml::Value::as_table));
    let ours = tables.into_iter().flatten().flatten().filter_map(|(name, value)| {
        match value.get("path").and_then(toml::Value::as_str) {
            Some(path) => Some(package.join(path)),
            None => Some(repository().join(of_workspace.get(name)?.get("path")?.as_str()?)),
        }
    });
    ours.map(|folder| fs::canonicalize(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())))
        .collect()
}

#[test]
fn folders_use_those_below_them() {
    let root = fs::canonicalize(repository()).unwrap();
    let manifest: Table = fs::read_to_string(root.join("Cargo.toml")).unwrap().parse().unwrap();
    let of_workspace = manifest["workspace"]["dependencies"].as_table().unwrap();
    let mut found = Vec::new();
    packages(&root, &mut found);
    let top = |folder: &Path| folder.components().next().unwrap().as_os_str().to_str().unwrap().to_owned();
    let mut against = Vec::new();
    let mut arrows = 0;
    for package in &found {
        let from = package.strip_prefix(&root).unwrap();
        let Some((_, may_use)) = USES.iter().find(|(folder, _)| *folder == top(from)) else {
            assert!(["tests", "xtask"].contains(&top(from).as_str()), "{}: a folder without a rule", from.display());
            continue;
        };
        for to in used(package, of_workspace) {
            let to = to.strip_prefix(&root).unwrap();
            arrows += 1;
            if top(to) != top(from) && !may_use.contains(&top(to).as_str()) {
                against.push((from.to_str().unwrap().to_owned(), to.to_str().unwrap().to_owned()));
            }
        }
    }
    assert!(arrows > 100, "{arrows}");
    against.sort();
    assert_eq!(against, AGAINST_THE_RULE.map(|(from, to)| (from.to_owned(), to.to_owned())));
}

/// Folders of the packages whose files do not import each other in circles.
const WITHOUT_CIRCLES: [&str; 4] = ["planner", "hal-shim", "printer", "desk"];

#[test]
fn files_do_not_import_each_other_in_circles() {
    let root = fs::canonicalize(repository()).unwrap();
    let mut found: Vec<PathBuf> = WITHOUT_CIRCLES.iter().map(|folder| root.join(folder)).collect();
    for folder in WITHOUT_CIRCLES {
        packages(&root.join(folder), &mut found);
    }
    let mut circles = Vec::new();
    for package in found.iter().filter(|package| package.join("src").is_dir()) {
        let name = package.strip_prefix(&root).unwrap().to_str().unwrap();
        circles.extend(Imports::of(package).circles().iter().map(|files| (name.to_owned(), files.join(" "))));
    }
    assert!(circles.is_empty(), "let one of the files import no other, or move what both need below them: {circles:?}");
}

#[test]
fn only_commands_know_the_printer() {
    let imports = Imports::of(&repository().join("printer"));
    assert_eq!(imports.importers("commands"), ["lib"]);
    let others = imports.importers("printer");
    let outside: Vec<&String> = others.iter().filter(|file| !file.starts_with("commands")).collect();
    assert_eq!(outside, ["lib"]);
    assert!(others.len() > 40, "{others:?}");
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
