//! Parts of the book that are made from code: between two marks, compared by a test and written
//! by it on request.

use std::path::Path;
use std::sync::Mutex;

/// Variable that makes [`keep`] write instead of comparing.
pub const REFRESH_VARIABLE: &str = "FERROSTEP_REFRESH";

/// Tests run at once, and some keep parts of the same page.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Compares the part of a page between `<!-- NAME begin` and `<!-- NAME end -->` with `text`, or
/// writes it if [`REFRESH_VARIABLE`] is set. The rest of the line with the first mark is a comment.
///
/// # Errors
/// What to do: the page cannot be read or written, has no such marks, or has another
/// text between them.
pub fn keep(page: &Path, name: &str, text: &str) -> Result<(), String> {
    keep_or_write(page, name, text, is_written())
}

/// Returns true if [`keep`] writes: a table of which a run makes only some rows is then made whole.
pub fn is_written() -> bool {
    std::env::var_os(REFRESH_VARIABLE).is_some()
}

/// Finds each line of `text` in the part of the page that [`keep`] would compare: some
/// rows of a table.
///
/// # Errors
/// The page cannot be read, has no such marks, or lacks a line.
pub fn has_lines(page: &Path, name: &str, text: &str) -> Result<(), String> {
    let _guard = ONE_AT_A_TIME.lock();
    let whole = std::fs::read_to_string(page).map_err(|error| format!("{}: {error}", page.display()))?;
    let (first, last) = (format!("<!-- {name} begin"), format!("<!-- {name} end -->"));
    let part = whole.split_once(&first).and_then(|(_, rest)| rest.split_once(&last)).map_or("", |(part, _)| part);
    match text.lines().find(|line| !part.lines().any(|kept| kept == *line)) {
        Some(line) => Err(format!("{} lacks {line:?}: run this test with {REFRESH_VARIABLE}=1", page.display())),
        None => Ok(()),
    }
}

fn keep_or_write(page: &Path, name: &str, text: &str, is_written: bool) -> Result<(), String> {
    let _guard = ONE_AT_A_TIME.lock();
    let failed = |error: std::io::Error| format!("{}: {error}", page.display());
    let whole = std::fs::read_to_string(page).map_err(failed)?;
    let (first, last) = (format!("<!-- {name} begin"), format!("<!-- {name} end -->"));
    let marks = || {
        let start = whole.find(&first)?;
        let start = start + whole[start..].find("-->\n")? + 4;
        Some((start, start + whole[start..].find(&last)?))
    };
    let (start, end) = marks().ok_or_else(|| format!("{}: no marks \"{first} -->\" and \"{last}\"", page.display()))?;
    // A blank line on either side, for Markdown.
    let text = format!("\n{}\n\n", text.trim_end());
    if whole[start..end] == text {
        return Ok(());
    }
    if !is_written {
        return Err(format!("{} is not current: run this test with {REFRESH_VARIABLE}=1", page.display()));
    }
    std::fs::write(page, format!("{}{text}{}", &whole[..start], &whole[end..])).map_err(failed)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn another_text_is_reported_and_kept() {
        let page = std::env::temp_dir().join(format!("ferrostep-book-{}.md", std::process::id()));
        let whole = "# Page\n\n<!-- keys begin: made by a test -->\n\n| a |\n\n<!-- keys end -->\nend\n";
        std::fs::write(&page, whole).unwrap();
        let read = || std::fs::read_to_string(&page).unwrap();
        assert_eq!(keep_or_write(&page, "keys", "| a |\n", false), Ok(()));
        assert!(keep_or_write(&page, "keys", "| b |\n", false).unwrap_err().contains("FERROSTEP_REFRESH=1"));
        assert!(keep_or_write(&page, "key", "", true).unwrap_err().contains("no marks"));
        assert_eq!(read(), whole);
        assert_eq!(has_lines(&page, "keys", "| a |"), Ok(()));
        assert!(has_lines(&page, "keys", "| a |\nend").unwrap_err().contains("\"end\""));
        assert!(has_lines(&page, "key", "| a |").is_err());
        assert_eq!(keep_or_write(&page, "keys", "| b |", true), Ok(()));
        assert_eq!(read(), whole.replace("| a |", "| b |"));
        std::fs::remove_file(&page).unwrap();
    }
}
