//! Results on standard output, messages on standard error.

use std::fmt::Display;
use std::io::{self, Write};

use ferrostep_host::printable::escaped;

/// Writes a result to standard output. A closed pipe (`| head`) is not an error.
///
/// # Errors
/// The result could not be written.
pub fn write_result(text: &str) -> Result<(), String> {
    let mut out = io::stdout().lock();
    result_written(out.write_all(escaped(text).as_bytes()).and_then(|()| out.flush()))
}

/// Writes a result in JSON to standard output.
///
/// # Errors
/// The result could not be written, or not be put into JSON.
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

#[cfg(test)]
mod tests {
    use super::*;

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
