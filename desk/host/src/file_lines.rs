//! Reads the lines of a file that is sent to a printer, and the command in each.

use std::fmt;
use std::io::{self, BufRead};

use ferrostep_gcode::{Checksum, Command, LINE_CAPACITY, LineReader, parse};

/// Maximum length of a line, including its comment. A packed file could unpack to a line larger
/// than the memory.
const MAX_LINE_BYTES: usize = 64 * 1024;

/// Splits a file into lines ended by `
///
/// `, `\r` or `\r
///
/// `, as [`LineReader`] does.
#[derive(Debug)]
pub struct FileLines<R> {
    input: R,
    /// True if the last line ended with `\r`: a `
    ///
    /// ` right after it belongs to the same line end.
    after_return: bool,
}

impl<R: BufRead> FileLines<R> {
    /// Reads lines from the input's current position.
    pub fn new(input: R) -> Self {
        Self { input, after_return: false }
    }
}

impl<R: BufRead> Iterator for FileLines<R> {
    type Item = io::Result<Vec<u8>>;

    /// Returns the next line without its line end.
    fn next(&mut self) -> Option<Self::Item> {
        let mut line = Vec::new();
        loop {
            let portion = match self.input.fill_buf() {
                Ok(portion) => portion,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Some(Err(error)),
            };
            let Some(&first) = portion.first() else {
                return (!line.is_empty()).then_some(Ok(line));
            };
            if std::mem::take(&mut self.after_return) && first == b'\n' {
                self.input.consume(1);
                continue;
            }
            let end = memchr::memchr2(b'\n', b'\r', portion);
            let text = portion.get(..end.unwrap_or(portion.len())).unwrap_or_default();
            if line.len() + text.len() > MAX_LINE_BYTES {
                return Some(Err(io::Error::other(format!("a line is longer than {MAX_LINE_BYTES} bytes"))));
            }
            line.extend_from_slice(text);
            let used = text.len() + usize::from(end.is_some());
            self.after_return = end.and_then(|end| portion.get(end)) == Some(&b'\r');
            self.input.consume(used);
            if end.is_some() {
                return Some(Ok(line));
            }
        }
    }
}

/// A line of a file whose own number or checksum shows that it is damaged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damaged(String);

impl fmt::Display for Damaged {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.0)
    }
}

/// Extracts the command of a line, without its comment, line number and checksum: a line on its way
/// to a printer gets new ones. M110 is dropped for the same reason, since it numbers the file's
/// lines. Returns `None` if no command is left. Text that this reader cannot parse is passed on,
/// because the printer may know it.
///
/// # Errors
/// The line's checksum is wrong.
pub fn command_of(line: &[u8]) -> Result<Option<String>, Damaged> {
    let mut reader = LineReader::new();
    let mut rest = line;
    while !rest.is_empty() {
        let (used, _) = reader.feed(rest);
        rest = rest.get(used.max(1)..).unwrap_or_default();
    }
    let command = line.split(|&byte| byte == b';').next().unwrap_or_default();
    let whole = || {
        let command = String::from_utf8_lossy(command).trim().to_owned();
        Ok((!command.is_empty()).then_some(command))
    };
    match reader.finish() {
        None => Ok(None),
        // `LineReader` keeps only the beginning of a line that is too long and has no effect here.
        Some(Ok(kept)) if kept.number.is_none() && command.len() > LINE_CAPACITY => whole(),
        Some(Ok(line)) => match line.checksum {
            Checksum::Absent | Checksum::Right if line.text.is_empty() => Ok(None),
            Checksum::Absent | Checksum::Right => {
                Ok((!matches!(parse(line.text), Ok(Command::SetLineNumber(_)))).then(|| line.text.to_owned()))
            }
            Checksum::Wrong { expected, computed } => Err(Damaged(format!(
                "{:?}: checksum mismatch: the line says {expected}, expected {computed}",
                line.text
            ))),
            Checksum::Malformed => Err(Damaged(format!(
                "{:?}: malformed checksum, expected a number from 0 to 255 after the '*'",
                line.text
            ))),
        },
        // The line already has a number and would be numbered twice.
        Some(Err(error)) if error.is_numbered() => Err(Damaged(error.to_string())),
        Some(Err(_)) => whole(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::io::BufReader;

    use super::*;

    fn lines(text: &str, capacity: usize) -> Vec<String> {
        let mut lines = FileLines::new(BufReader::with_capacity(capacity, text.as_bytes()));
        std::iter::from_fn(|| lines.next()).map(|line| String::from_utf8(line.unwrap()).unwrap()).collect()
    }

    #[test]
    fn each_line_end_ends_a_line_in_portions_of_any_size() {
        for capacity in 1..20 {
            assert_eq!(lines("G28\rG1 X1\r\nG1 X2\n\nG1 X3", capacity), ["G28", "G1 X1", "G1 X2", "", "G1 X3"]);
            assert_eq!(lines("a\r\r\nb\r", capacity), ["a", "", "b"]);
            assert!(lines("", capacity).is_empty());
        }
    }

    #[test]
    fn numbers_checksums_and_m110_are_the_file_s() {
        for (line, expected) in [
            ("N10 G28", Some("G28")),
            ("N3 T0*57 ; tool", Some("T0")),
            ("N24 G1 Z2.0 F3000*45", Some("G1 Z2.0 F3000")),
            ("  G1 X5 ; hop", Some("G1 X5")),
            ("M117 2*3", Some("M117 2*3")),
            ("M110", None),
            ("m110 n0", None),
            ("N0 M110 N0*125", None),
            ("N5", None),
            ("; N1 G28", None),
            ("", None),
        ] {
            assert_eq!(command_of(line.as_bytes()).unwrap().as_deref(), expected, "{line}");
        }
        let commented = format!("M110 N0 ; {}", "x".repeat(300));
        assert_eq!(command_of(commented.as_bytes()).unwrap(), None);
        let says = command_of(b"N3 T0*56").unwrap_err().to_string();
        assert_eq!(says, "\"T0\": checksum mismatch: the line says 56, expected 57");
        assert!(command_of(b"N3 T0*57*1").is_err());
        assert!(command_of(&[b"N1 G1 X".as_slice(), &[b'1'; 300]].concat()).is_err());
    }

    #[test]
    fn what_only_a_printer_may_know_is_passed_on() {
        let long = format!("EXCLUDE_OBJECT_DEFINE POLYGON={}", "1,".repeat(400));
        assert_eq!(command_of(long.as_bytes()).unwrap().as_deref(), Some(long.as_str()));
        assert_eq!(command_of(b"M117 \xff").unwrap().as_deref(), Some("M117"));
    }
}
