//! Files that a configuration includes.

/// Maximum number of included files.
pub(crate) const MAX_INCLUDES: usize = 100;

/// A file's name and its text, or why it cannot be read.
pub type Included = Result<Vec<(String, String)>, String>;

/// The name of a file that another one includes, relative to where the first one is.
pub(crate) fn beside(file: &str, include: &str) -> String {
    match file.rsplit_once('/') {
        Some((folder, _)) if !include.starts_with('/') => format!("{folder}/{include}"),
        _ => include.to_owned(),
    }
}
