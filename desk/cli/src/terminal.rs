//! Results on standard output, messages on standard error.
//!
//! File names, G-code and a board's replies may contain control characters, which can make a terminal do nearly anything. They
//! are written as escape sequences.

use std::borrow::Cow;
use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;

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

/// A text of one or more lines without control characters: `\u{1b}` stands for an ESC. Line ends and tabs stay.
pub fn escaped(text: &str) -> Cow<'_, str> {
    replaced(text, |c| c.is_control() && c != '\n' && c != '\t')
}

/// The same for a text that is one line: what would end it is replaced, too.
pub fn one_line(text: &str) -> Cow<'_, str> {
    replaced(text, char::is_control)
}

/// A path on one line, without control characters.
pub fn name(path: &Path) -> String {
    one_line(&path.to_string_lossy()).into_owned()
}

/// Writes a result to standard output. A closed pipe (`| head`) is not an error.
///
/// # Errors
/// It could not be written.
pub fn write_result(text: &str) -> Result<(), String> {
    let mut out = io::stdout().lock();
    result_written(out.write_all(escaped(text).as_bytes()).and_then(|()| out.flush()))
}

/// Writes a result in JSON to standard output.
///
/// # Errors
/// It could not be written, or not be put into JSON.
pub fn write_json(result: &impl serde::Serialize) -> Result<(), String> {
    let text = serde_json::to_string_pretty(result).map_err(|error| error.to_string())?;
    write_result(&json_escaped(&text))
}

/// Escapes the control characters that serde_json leaves as they are, those from U+007F on.
fn json_escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 1);
    for c in text.chars() {
        if c.is_control() && c != '\n' {
            out += &format!("\\u{:04x}", u32::from(c));
        } else {
            out.push(c);
        }
    }
    out.push('\n');
    out
}

/// The error of writing to standard output, in words; a closed pipe is not an error.
///
/// # Errors
/// Writing failed for another reason than a closed pipe.
pub fn result_written(outcome: io::Result<()>) -> Result<(), String> {
    match outcome {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(format!("standard output: cannot be written: {error}"))
        }
        _ => Ok(()),
    }
}

/// Writes a line to standard error; a failure there cannot be reported anywhere.
pub fn tell(message: impl Display) {
    let _ = writeln!(io::stderr(), "{}", escaped(&message.to_string()));
}

/// The command at the start of a line, `M600` or `G29.1`, or its first word.
pub fn code(text: &str) -> &str {
    let digits = |from: usize| text.bytes().skip(from).take_while(u8::is_ascii_digit).count();
    let mut end = match (text.bytes().next(), digits(1)) {
        (Some(letter), number) if letter.is_ascii_alphabetic() && number > 0 => 1 + number,
        _ => return text.split([' ', '\t']).next().unwrap_or_default(),
    };
    if text.as_bytes().get(end) == Some(&b'.') {
        end += 1 + digits(end + 1);
    }
    text.get(..end).unwrap_or_default()
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

    #[test]
    fn escaping_keeps_the_json_value() {
        let value = serde_json::json!({"file": "a\x1b\u{9b}\u{7f}\n"});
        let text = json_escaped(&value.to_string());
        assert_eq!(text, "{\"file\":\"a\\u001b\\u009b\\u007f\\n\"}\n");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).ok(), Some(value));
    }

    #[test]
    fn a_closed_pipe_is_not_an_error() {
        assert_eq!(result_written(Err(io::ErrorKind::BrokenPipe.into())), Ok(()));
        assert!(result_written(Err(io::ErrorKind::StorageFull.into())).is_err());
    }
}
