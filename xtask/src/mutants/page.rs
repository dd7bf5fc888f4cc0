//! The page of survivors, with which the next run is compared.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::tried::{Files, Tried};
use crate::generated::Page;
use crate::steps::Failure;
use crate::system;

/// The page.
pub const PAGE: Page = Page { path: "tests/mutants.md", command: "cargo xtask mutants --refresh" };

/// The page's contents.
pub fn read() -> Result<Files, Failure> {
    parsed(PAGE.generated(&PAGE.read()?)?)
}

/// Writes the results of the files that were tried; those of other files that still exist stay.
pub fn write(tried: &Files) -> Result<(), Failure> {
    let mut files = read()?;
    files.retain(|file, _| system::root().join(file).is_file());
    files.extend(tried.iter().map(|(file, tried)| (file.clone(), tried.clone())));
    PAGE.write(&shown(&files))
}

/// A table of all files, and a list of each one's survivors.
fn shown(files: &Files) -> String {
    let mut text = String::from("| file | mutants | survive |\n|---|---|---|\n");
    let sum = |number: fn(&Tried) -> usize| files.values().map(number).sum::<usize>();
    for (file, tried) in files {
        let _ = writeln!(text, "| `{file}` | {} | {} |", tried.mutants, tried.survivors());
    }
    let _ = writeln!(text, "| all | {} | {} |", sum(|tried| tried.mutants), sum(Tried::survivors));
    for (file, tried) in files.iter().filter(|(_, tried)| tried.survivors() > 0) {
        let _ = write!(text, "\n### `{file}`\n\n");
        for (change, count) in &tried.survivors {
            let times = if *count == 1 { String::new() } else { format!(", {count} times") };
            let _ = writeln!(text, "- `{change}`{times}");
        }
    }
    text
}

/// Reads what [`shown`] has written.
fn parsed(text: &str) -> Result<Files, Failure> {
    let mut files = Files::new();
    let mut file = None;
    for line in text.lines() {
        let lost = || format!("{}: this line is not a file, number or survivor: {line}", PAGE.path);
        if let Some(row) = line.strip_prefix("| `") {
            let (name, numbers) = row.split_once("` | ").ok_or_else(lost)?;
            let mutants = numbers.split(' ').next().and_then(|number| number.parse().ok()).ok_or_else(lost)?;
            files.insert(name.to_owned(), Tried { mutants, survivors: BTreeMap::new() });
        } else if let Some(name) = line.strip_prefix("### `") {
            file = name.strip_suffix('`').map(str::to_owned);
        } else if let Some(survivor) = line.strip_prefix("- `") {
            let (change, times) = survivor.rsplit_once('`').ok_or_else(lost)?;
            let count = match times {
                "" => 1,
                times => {
                    let number = times.strip_prefix(", ").and_then(|times| times.strip_suffix(" times"));
                    number.and_then(|number| number.parse().ok()).ok_or_else(lost)?
                }
            };
            let tried = file.as_ref().and_then(|file| files.get_mut(file)).ok_or_else(lost)?;
            tried.survivors.insert(change.to_owned(), count);
        }
    }
    Ok(files)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        let survivors = [("replace f with ()", 1), ("replace | with ^ in <impl A for B<'_>>::g", 12)];
        let survivors = survivors.map(|(change, count)| (change.to_owned(), count)).into();
        let files = Files::from([
            ("a/b.rs".to_owned(), Tried { mutants: 40, survivors }),
            ("c.rs".to_owned(), Tried { mutants: 7, survivors: BTreeMap::new() }),
        ]);
        let text = shown(&files);
        assert!(text.contains("| `a/b.rs` | 40 | 13 |\n") && text.contains("| all | 47 | 13 |\n"), "{text}");
        assert_eq!(parsed(&text).unwrap(), files);
        assert_eq!(parsed("").unwrap(), Files::new());
    }

    #[test]
    fn a_malformed_line_is_named() {
        for line in ["| `a.rs` | x | 3 |", "- `a change of no file`", "### `a.rs`\n- `f`, many times"] {
            let error = parsed(line).unwrap_err();
            assert!(error.contains(line.lines().last().unwrap()), "{error}");
        }
    }

    /// An edit or a merge can damage the page: its sums must be those of its lists.
    #[test]
    fn the_page_is_as_it_was_written() {
        let text = PAGE.read().unwrap();
        let files = read().unwrap();
        assert_eq!(PAGE.replaced(&text, &shown(&files)).unwrap(), text, "`{}` writes it", PAGE.command);
    }
}
