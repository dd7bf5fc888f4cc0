//! Makes text from outside safe to show in a terminal.
//!
//! File names, G-code and a board's replies may contain control characters, which can make a
//! terminal do nearly anything. This module replaces them with escape sequences.

use std::borrow::Cow;
use std::path::Path;

/// File name that means standard input.
const STANDARD_INPUT: &str = "-";

/// Replaces every character for which `is_replaced` holds with its Rust escape sequence.
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

/// Escapes control characters, such as `\u{1b}` for ESC, in a text of one or more lines. Line feeds
/// and tabs stay.
pub fn escaped(text: &str) -> Cow<'_, str> {
    replaced(text, |c| c.is_control() && c != '\n' && c != '\t')
}

/// Escapes control characters in a text of one line, including line ends and tabs.
pub fn one_line(text: &str) -> Cow<'_, str> {
    replaced(text, char::is_control)
}

/// Formats a path on one line without control characters.
pub fn name(path: &Path) -> String {
    one_line(&path.to_string_lossy()).into_owned()
}

/// Returns true if a path means standard input.
pub fn is_standard_input(path: &Path) -> bool {
    path.as_os_str() == STANDARD_INPUT
}

/// Formats the name of an input file for messages, on one line; `-` becomes "standard input".
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
