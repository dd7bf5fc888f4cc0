//! The text of a configuration file.

use std::io::Read;
use std::path::Path;

/// Longest file that is read, bytes; files of printers have less than a tenth.
const MAX_BYTES: u64 = 1 << 20;

/// The text of a file. One of Marlin's may have signs of Latin-1 in its comments, as the
/// compiler takes it.
pub(crate) fn of_file(path: &Path) -> Result<String, String> {
    if path.is_dir() {
        return Err("this is a folder, expected a file".to_owned());
    }
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(|error| reason(&error))?;
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(|error| reason(&error))?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err("larger than 1 MiB, which no configuration is: is it another file?".to_owned());
    }
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err("this is UTF-16 text: save it as UTF-8".to_owned());
    }
    let is_header = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("h"));
    match String::from_utf8(bytes) {
        Ok(text) => Ok(text),
        Err(error) if is_header && !error.as_bytes().contains(&0) => {
            Ok(error.as_bytes().iter().map(|byte| char::from(*byte)).collect())
        }
        Err(error) => {
            let before = error.as_bytes().iter().take(error.utf8_error().valid_up_to());
            let line = 1 + before.filter(|byte| **byte == b'\n').count();
            Err(format!("line {line} is not UTF-8 text: save the file as UTF-8"))
        }
    }
}

fn reason(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".to_owned(),
        std::io::ErrorKind::PermissionDenied => "its rights do not allow that".to_owned(),
        _ => error.to_string(),
    }
}

/// A text whose lines all end in the same way.
pub(crate) fn with_line_ends(text: &str) -> String {
    text.replace("\r\n", "\n").replace('\r', "\n")
}

/// A text of one line, cut where it is long.
pub(crate) fn shown(text: &str) -> String {
    const MAX: usize = 60;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= MAX {
        return line;
    }
    line.chars().take(MAX - 1).chain(['…']).collect()
}
