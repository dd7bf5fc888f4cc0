//! Lint of the wording of comments and pages: the count of each file's known faults may only fall.
//!
//! A line of a comment has at most [`WIDTH`] columns, but for a row of a table.
//! A doc comment begins with a noun phrase or a verb that says what the item is or does, not with
//! the fragment of a question ([`OPENERS`]), and neither comments nor pages have the turns of
//! phrase in [`TICS`].

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::json;

use crate::steps::Failure;
use crate::system;

/// Known faults by file, from the root.
const KNOWN: &str = "xtask/prose.json";

/// Widest line of a comment, columns.
const WIDTH: usize = 100;

/// First words that make the first line of a doc comment a fragment.
const OPENERS: [&str; 10] = ["What", "Whether", "Of", "How", "By how", "Where", "Which", "When", "Why", "From where"];

/// Turns of phrase that a plain sentence does not need, with what to write.
const TICS: [(&str, &str); 11] = [
    ("is none", "say what is there: empty, missing, not a ..."),
    ("are none", "say what is there: empty, missing, not ..."),
    ("of its own", "own, separate"),
    ("in the place of", "instead of"),
    ("in its place", "instead"),
    ("nobody", "name the subject"),
    ("somebody", "name the subject"),
    (", too.", "also"),
    (", too,", "also"),
    ("goes on", "continues"),
    ("so many", "the number"),
];

/// A fault: its line, counted from 1, and what is wrong with it.
type Fault = (usize, String);

/// Faults by file, from the root.
type Counts = BTreeMap<String, usize>;

/// Compares each file's faults with the known ones.
///
/// # Errors
/// A file has more of them; all of its faults are in the error, by line.
pub fn check() -> Result<(), Failure> {
    let known = known()?;
    let grown: Vec<Failure> = files()?
        .iter()
        .filter_map(|file| {
            let faults = faults_of(file).ok()?;
            let most = known.get(file).copied().unwrap_or(0);
            (faults.len() > most).then(|| {
                let lines = faults.iter().map(|(line, fault)| format!("{file}:{line}: {fault}\n"));
                format!("{}{file}: {} faults of wording, {most} before\n", lines.collect::<String>(), faults.len())
            })
        })
        .collect();
    if grown.is_empty() { Ok(()) } else { Err(grown.concat()) }
}

/// Keeps the present counts where they have fallen; a file that is not known keeps its own.
///
/// # Errors
/// The list cannot be read or written.
pub fn save() -> Result<(), Failure> {
    let known = known()?;
    let mut counts = Counts::new();
    for file in files()? {
        let count = faults_of(&file)?.len();
        let least = known.get(&file).map_or(count, |most| count.min(*most));
        if least > 0 {
            counts.insert(file, least);
        }
    }
    let text = serde_json::to_string_pretty(&json!(counts)).map_err(|error| error.to_string())?;
    eprintln!("{} faults of wording in {} files", counts.values().sum::<usize>(), counts.len());
    std::fs::write(system::root().join(KNOWN), text + "\n").map_err(|error| format!("{KNOWN}: {error}"))
}

fn known() -> Result<Counts, Failure> {
    let text = std::fs::read_to_string(system::root().join(KNOWN))
        .map_err(|error| format!("{KNOWN}: {error}: `cargo xtask prose --save` writes it"))?;
    serde_json::from_str(&text).map_err(|error| format!("{KNOWN}: {error}"))
}

/// Sources and pages that git knows, from the root.
fn files() -> Result<Vec<String>, Failure> {
    let mut git = Command::new("git");
    git.current_dir(system::root()).args(["ls-files", "*.rs", "*.js", "*.toml", "*.py", "*.md"]);
    // The list itself has the words that it looks for.
    let is_read = |file: &&str| *file != "xtask/src/prose.rs" && *file != "CHANGELOG.md";
    Ok(system::run_for_output(&mut git)?.lines().filter(is_read).map(str::to_owned).collect())
}

fn faults_of(file: &str) -> Result<Vec<Fault>, Failure> {
    let path: PathBuf = system::root().join(file);
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{file}: {error}"))?;
    Ok(comment_mark(file).map_or_else(|| faults_of_page(&text), |mark| faults_of_source(&text, mark)))
}

/// Mark that begins a line of a comment in a file of this name; `None` for a page.
fn comment_mark(file: &str) -> Option<&'static str> {
    match Path::new(file).extension()?.to_str()? {
        "rs" | "js" => Some("//"),
        "toml" | "py" => Some("#"),
        _ => None,
    }
}

fn faults_of_source(text: &str, mark: &str) -> Vec<Fault> {
    let mut faults = Vec::new();
    let mut within_comment = false;
    for (number, line) in (1..).zip(text.lines()) {
        let comment = line.trim_start().strip_prefix(mark);
        if let Some(comment) = comment {
            let doc = comment.strip_prefix(['/', '!']).map(str::trim_start).filter(|_| !within_comment);
            if let Some(opener) = doc.and_then(opener) {
                faults.push((number, format!("a doc comment begins with \"{opener}\": say what the item is or does")));
            }
            faults.extend(tics(comment).map(|tic| (number, tic)));
            let is_row = comment.trim_start_matches(['/', '!', ' ']).starts_with('|');
            if !is_row && line.chars().count() > WIDTH {
                faults.push((number, format!("a comment line of more than {WIDTH} columns: wrap it")));
            }
        }
        within_comment = comment.is_some();
    }
    faults
}

fn faults_of_page(text: &str) -> Vec<Fault> {
    let mut within_code = false;
    let mut faults = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        if line.trim_start().starts_with("```") {
            within_code = !within_code;
        }
        if !within_code && !line.starts_with("    ") {
            faults.extend(tics(line).map(|tic| (number, tic)));
        }
    }
    faults
}

/// The opener that a doc comment begins with.
fn opener(text: &str) -> Option<&'static str> {
    let begins = |opener: &&&str| text.strip_prefix(**opener).is_some_and(|rest| rest.starts_with([' ', ',']));
    OPENERS.iter().find(begins).copied()
}

fn tics(text: &str) -> impl Iterator<Item = String> {
    let found = TICS.iter().filter(move |(tic, _)| text.contains(tic));
    found.map(|(tic, instead)| format!("\"{tic}\": {instead}"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_fragment_is_found_at_the_beginning_of_a_doc_comment_only() {
        let text = "/// Whether it moves.\nfn a() {}\n/// True while it moves, and\n/// Where it is.\n// When it moves, it is warm.\n";
        let lines: Vec<usize> = faults_of_source(text, "//").into_iter().map(|(line, _)| line).collect();
        assert_eq!(lines, [1]);
        assert_eq!(faults_of_source("    //! Of a move.\n", "//").len(), 1);
        assert!(faults_of_source("/// Offset of a move.\n/// Howitzer.\n", "//").is_empty());
    }

    #[test]
    fn a_tic_is_found_in_comments_and_pages_but_not_in_code() {
        assert_eq!(faults_of_source("// There is none.\nlet text = \"is none\";\n", "//").len(), 1);
        assert_eq!(faults_of_page("It goes on.\n\n    it goes on\n\n```\ngoes on\n```\n").len(), 1);
    }

    #[test]
    fn a_wide_line_is_found_in_comments_but_not_in_code_or_tables() {
        let (fits, wide) = ("x".repeat(WIDTH - 3), "x".repeat(WIDTH - 2));
        let text = format!("// {fits}\n// {wide}\nlet {wide};\n/// | {wide} |\n    /// {wide}\n");
        let lines: Vec<usize> = faults_of_source(&text, "//").into_iter().map(|(line, _)| line).collect();
        assert_eq!(lines, [2, 5]);
        assert_eq!(faults_of_source(&format!("#  {wide}\nkey = \"#  {wide}\"\n"), "#").len(), 1);
    }

    #[test]
    fn each_file_is_read_by_its_mark() {
        let names = ["a.rs", "a.js", "a.toml", "a.py", "a.md"];
        assert_eq!(names.map(comment_mark), [Some("//"), Some("//"), Some("#"), Some("#"), None]);
    }

    #[test]
    fn every_known_file_exists() {
        let files = files().unwrap();
        let gone: Vec<String> = known().unwrap().into_keys().filter(|file| !files.contains(file)).collect();
        assert!(gone.is_empty(), "`cargo xtask prose --save` forgets them: {gone:?}");
    }
}
