//! The lines of an uploaded file.

use std::io::{self, BufReader};
use std::path::Path;

use ferrostep_host::file_lines::FileLines;

use crate::input::Input;

/// An open file, which remembers why it could not be read on.
pub struct JobLines {
    lines: FileLines<BufReader<Input>>,
    /// Error with which a line could not be read.
    pub failed: Option<String>,
}

impl JobLines {
    /// Opens a file of G-code.
    ///
    /// # Errors
    /// The file is not G-code, in words for a person.
    pub fn open(path: &Path) -> Result<Self, String> {
        let input = Input::open(path).map_err(|error| error.to_string())?;
        if input.is_prepared() {
            return Err(
                "this is a prepared job, which the page cannot send: use `ferrostep send`, or upload the G-code"
                    .to_owned(),
            );
        }
        Ok(Self { lines: FileLines::new(BufReader::new(input)), failed: None })
    }

    /// Counts the lines, up to one that cannot be read.
    pub fn count(mut self) -> u32 {
        std::iter::from_fn(|| self.next().and_then(Result::ok)).zip(1..=u32::MAX).last().map_or(0, |(_, number)| number)
    }

    /// The next line; `None` at the end.
    pub fn next(&mut self) -> Option<io::Result<Vec<u8>>> {
        let outcome = self.lines.next()?;
        self.failed = outcome.as_ref().err().map(ToString::to_string);
        Some(outcome)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_line_without_an_end_is_refused() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), format!("G28\n;{}", "a".repeat(100_000))).unwrap();
        let mut lines = JobLines::open(file.path()).unwrap();
        assert_eq!(lines.next().unwrap().unwrap(), b"G28");
        assert!(lines.next().unwrap().is_err() && lines.failed.unwrap().contains("longer than"));
        assert_eq!(JobLines::open(file.path()).unwrap().count(), 1);
    }
}
