//! TOML files that people write: read key by key, and refused with the key, the line and
//! the right values.
//!
//! A file's schema is the code that reads it: each call on a [`Section`] declares a key with its
//! range, its default, and its meaning. From the same calls follow the values, the refusals, the
//! book's table ([`Schema::markdown`]) and a hash of the values that bind other files to this one
//! ([`Checked`]). Profiles and boards are such files.

pub mod book;
mod error;
mod field;
pub mod keys;
mod locate;
mod range;
mod reader;
mod schema;
mod section;
mod values;
mod words;

use std::io::Read;

pub use error::{FileError, Problem};
pub use field::Field;
pub use locate::{line_of, line_of_key};
pub use range::{Range, range};
pub use reader::{Checked, Reader};
pub use schema::{Key, Schema};
pub use section::Section;
pub use values::Choice;
pub use words::closest;

/// Longest file that is read, bytes. A path given by mistake may name a print of many megabytes, or
/// an endless device.
const MAX_BYTES: u64 = 1 << 20;

/// Reads a whole text file of at most 1 MiB; for errors, `what` names the expected kind of file,
/// and `built_in` the names that need no file.
///
/// # Errors
/// [`Problem::Read`]: it cannot be read, is not UTF-8 or too large.
pub fn read(
    path: &str,
    what: &'static str,
    built_in: impl IntoIterator<Item = &'static str>,
) -> Result<String, FileError> {
    read_text(path).map_err(|error| {
        let built_in: Vec<_> = built_in.into_iter().collect();
        let meant = closest(path, built_in.iter().copied());
        FileError::new(path, None, Problem::Read { what, meant, built_in, error })
    })
}

fn read_text(path: &str) -> std::io::Result<String> {
    let mut text = String::new();
    let mut file = std::fs::File::open(path)?.take(MAX_BYTES + 1);
    // A size limit met in the middle of a character is still a size limit, so bytes
    // first, UTF-8 second.
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(std::io::Error::new(std::io::ErrorKind::FileTooLarge, "larger than 1 MiB"));
    }
    bytes.as_slice().read_to_string(&mut text)?;
    Ok(text)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_found_in_every_way_to_write_it() {
        let text = "a = 1\n[b]\nc = { d = 2 }\n\n[b.e]\nf.g = 3\n";
        assert_eq!(line_of_key(text, "a"), Some(1));
        assert_eq!(line_of_key(text, "b.c.d"), Some(3));
        assert_eq!(line_of_key(text, "b.e.f.g"), Some(6));
        assert_eq!(line_of_key(text, "b.g"), None);
        assert_eq!(line_of_key("not toml", "a"), None);
    }

    #[test]
    fn a_file_that_cannot_be_read_names_those_that_need_no_file() {
        let error = read("/nonexistent/x.toml", "profile", ["one", "two"]).unwrap_err();
        let shown = error.to_string();
        let says = "/nonexistent/x.toml: there is no such file, and no built-in profile of this name (one, two)";
        assert_eq!(shown, says);
    }
}
