//! Lint of the wording of comments and pages.
//!
//! A line of a comment has at most [`WIDTH`] columns, but for a row of a table.
//! A doc comment begins with a noun phrase or a verb that says what the item is or does, not with
//! the fragment of a question ([`OPENERS`]), and neither comments nor pages have the turns of
//! phrase in [`TICS`].

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::steps::Failure;
use crate::system;

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

/// Looks through all comments and pages.
///
/// # Errors
/// Some have faults; each is in the error, by file and line.
pub fn check() -> Result<(), Failure> {
    let mut faults = Failure::new();
    for file in files()? {
        for (line, fault) in faults_of(&file)? {
            faults += &format!("{file}:{line}: {fault}\n");
        }
    }
    if faults.is_empty() { Ok(()) } else { Err(faults) }
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
    // Names and quoted output are between grave accents.
    let prose: Vec<&str> = text.split('`').step_by(2).collect();
    let found = TICS.iter().filter(move |(tic, _)| prose.iter().any(|part| part.contains(tic)));
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
        assert!(faults_of_page("It says `nobody read`, and a test is `that_nobody_reads`.\n").is_empty());
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
}
