//! The lines of an uploaded file.

use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use crate::input::Input;

/// Longest line, comment included. A packed file can hold one that fits no memory.
const MAX_LINE_BYTES: u64 = 64 * 1024;

/// An open file, which remembers why it could not be read on.
pub struct JobLines {
    input: BufReader<Input>,
    /// Why a line could not be read.
    pub failed: Option<String>,
}

impl JobLines {
    /// Opens a file of G-code.
    ///
    /// # Errors
    /// It is none, in words for a person.
    pub fn open(path: &Path) -> Result<Self, String> {
        let input = Input::open(path).map_err(|error| error.to_string())?;
        if input.is_prepared() {
            return Err(
                "this is a prepared job, which the page cannot send: use `ferrostep send`, or upload the G-code"
                    .to_owned(),
            );
        }
        Ok(Self { input: BufReader::new(input), failed: None })
    }

    /// How many lines there are, up to one that cannot be read.
    pub fn count(mut self) -> u32 {
        std::iter::from_fn(|| self.next().and_then(Result::ok)).zip(1..=u32::MAX).last().map_or(0, |(_, number)| number)
    }

    /// The next line; `None` at the end.
    pub fn next(&mut self) -> Option<io::Result<Vec<u8>>> {
        let mut line = Vec::new();
        let outcome = match (&mut self.input).take(MAX_LINE_BYTES).read_until(b'\n', &mut line) {
            Ok(0) => return None,
            Ok(_) if line.ends_with(b"\n") || (line.len() as u64) < MAX_LINE_BYTES => Ok(line),
            Ok(_) => Err(io::Error::other(format!("a line is longer than {MAX_LINE_BYTES} bytes"))),
            Err(error) => Err(error),
        };
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
        assert_eq!(lines.next().unwrap().unwrap(), b"G28\n");
        assert!(lines.next().unwrap().is_err() && lines.failed.unwrap().contains("longer than"));
        assert_eq!(JobLines::open(file.path()).unwrap().count(), 1);
    }
}
