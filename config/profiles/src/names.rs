//! Names that people choose for parts of a machine.

use ferrostep_checked_toml::Section;

/// Refuses the table `path` if its name has other characters than letters, digits and _, or
/// more than `longest`.
pub(crate) fn check_name(keys: &Section<'_>, path: &str, name: &str, longest: usize) {
    let is_name = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_';
    if name.len() > longest || !name.bytes().all(is_name) {
        keys.refuse(path, format!("a name of letters, digits and _, at most {longest}"));
    }
}
