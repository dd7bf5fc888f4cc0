//! Receives a file from a client into a temporary file, up to a limit.

use std::io::{self, Read, Write};

use tempfile::NamedTempFile;

use crate::answer::Answer;
use crate::deadline::is_slow;
use crate::printer::Upload;

/// Number of bytes copied at once.
pub const PORTION_BYTES: usize = 64 * 1024;

/// Maximum length of a displayed name, characters.
const MAX_NAME: usize = 100;

/// Receives `bytes` bytes from `body`.
///
/// # Errors
/// The answer to a body that is incomplete, too slow, or cannot be stored.
pub fn receive(body: &mut impl Read, bytes: u64, name: Option<&str>) -> Result<Upload, Answer> {
    let mut file = NamedTempFile::new().map_err(not_kept)?;
    let mut portion = vec![0; PORTION_BYTES];
    let mut left = bytes;
    while left > 0 {
        let room = usize::try_from(left).unwrap_or(usize::MAX).min(PORTION_BYTES);
        let read = match body.read(&mut portion[..room]) {
            Ok(0) => {
                return Err(Answer::text(400, format!("the file is cut off: {left} of its {bytes} bytes are missing")));
            }
            Ok(read) => read,
            Err(error) if is_slow(&error) => return Err(too_slow()),
            Err(error) => return Err(Answer::text(400, format!("the file did not come whole: {error}"))),
        };
        file.write_all(&portion[..read]).map_err(not_kept)?;
        left = left.saturating_sub(read as u64);
    }
    file.flush().map_err(not_kept)?;
    Ok(Upload { name: shown_name(name.unwrap_or_default()), file, bytes })
}

/// Returns the answer to a file that cannot be stored.
pub fn not_kept(error: io::Error) -> Answer {
    Answer::text(507, format!("the file cannot be kept: {error}"))
}

/// Returns the answer to a file that does not arrive in time.
pub fn too_slow() -> Answer {
    Answer::text(408, "the file did not come in time")
}

/// Decodes a percent-encoded name for display.
fn shown_name(encoded: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = encoded.as_bytes();
    while let [first, after @ ..] = rest {
        let decoded = match (first, after) {
            (b'%', [high, low, ..]) => {
                std::str::from_utf8(&[*high, *low]).ok().and_then(|hex| u8::from_str_radix(hex, 16).ok())
            }
            _ => None,
        };
        bytes.push(decoded.unwrap_or(*first));
        rest = if decoded.is_some() { after.get(2..).unwrap_or_default() } else { after };
    }
    let name: String =
        String::from_utf8_lossy(&bytes).chars().filter(|char| !char.is_control()).take(MAX_NAME).collect();
    if name.is_empty() { "unnamed".to_owned() } else { name }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn names_are_only_shown() {
        for (encoded, name) in [
            ("cube.gcode", "cube.gcode"),
            ("W%C3%BCrfel%20%3A.g", "Würfel :.g"),
            ("a%0Ab%1b", "ab"),
            ("%", "%"),
            ("%4", "%4"),
            ("%zz", "%zz"),
            ("", "unnamed"),
        ] {
            assert_eq!(shown_name(encoded), name);
        }
        assert_eq!(shown_name(&"a".repeat(1000)).len(), MAX_NAME);
    }

    #[test]
    fn a_file_comes_whole_or_not_at_all() {
        let upload = receive(&mut b"G28\nrest".as_slice(), 4, Some("../../a")).unwrap();
        assert_eq!((std::fs::read(upload.file.path()).unwrap(), upload.name.as_str()), (b"G28\n".to_vec(), "../../a"));
        let path = upload.file.path().to_owned();
        drop(upload);
        assert!(!path.exists());
        assert_eq!(receive(&mut b"G28".as_slice(), 4, None).unwrap_err().status, 400);
    }
}
