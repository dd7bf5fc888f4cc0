//! Texts from outside, as a terminal may show them.
//!
//! File names, G-code and a board's replies may contain control characters, which can make a
//! terminal do nearly anything. They are written as escape sequences.

use std::borrow::Cow;
use std::path::Path;

/// The name that means standard input.
const STANDARD_INPUT: &str = "-";

/// Replaces every control character for which `is_replaced` holds by its escape sequence in Rust.
fn replaced(text: &str, is_replaced: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_replaced) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if is_replaced(c) {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

/// A text of one or more lines without control characters: `\u{1b}` for an ESC. Line
/// ends and tabs stay.
pub fn escaped(text: &str) -> Cow<'_, str> {
    replaced(text, |c| c.is_control() && c != '\n' && c != '\t')
}

/// The same for a text that is one line: line ends are also replaced.
pub fn one_line(text: &str) -> Cow<'_, str> {
    replaced(text, char::is_control)
}

/// A path on one line, without control characters.
pub fn name(path: &Path) -> String {
    one_line(&path.to_string_lossy()).into_owned()
}

/// Returns true if a path means standard input.
pub fn is_standard_input(path: &Path) -> bool {
    path.as_os_str() == STANDARD_INPUT
}

/// A file that is read, on one line, as messages name it; `-` is standard input.
pub fn name_of_input(path: &Path) -> String {
    if is_standard_input(path) { "standard input".to_owned() } else { name(path) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_become_escape_sequences() {
        let text = "a\x1b[2J\r\u{7f}\u{9b}m\tb\nµ";
        assert_eq!(escaped(text), "a\\u{1b}[2J\\r\\u{7f}\\u{9b}m\tb\nµ");
        assert_eq!(one_line(text), "a\\u{1b}[2J\\r\\u{7f}\\u{9b}m\\tb\\nµ");
        assert!(matches!(escaped("plain\n"), Cow::Borrowed("plain\n")));
        assert_eq!(name(Path::new("x\x07.gcode")), "x\\u{7}.gcode");
    }
}
