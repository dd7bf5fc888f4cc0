//! The lines at which a file's layers begin, by the slicer's comments.

use std::io::{self, ErrorKind, Read};

use ferrostep_show::{CommentReader, Mark, Marks};

/// Reads a file to its end; the line of each layer's beginning, from 1.
///
/// # Errors
/// The file cannot be read.
pub fn layer_lines(mut input: impl Read) -> io::Result<Vec<u32>> {
    let (mut reader, mut marks, mut found) = (CommentReader::default(), Marks::default(), Vec::new());
    let mut note = |line, comment: &str| found.extend((marks.read(comment) == Some(Mark::Layer)).then_some(line));
    let mut portion = vec![0; 1 << 16];
    loop {
        match input.read(&mut portion) {
            Ok(0) => break,
            Ok(length) => reader.read(portion.get(..length).unwrap_or_default(), &mut note),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    reader.end(&mut note);
    Ok(found)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn layers_begin_at_their_comments() {
        let text = format!(
            "; begin\r;LAYER_CHANGE\nG1 X1\n;{}\r\n;LAYER_CHANGE\nG1 X2 ;LAYER_CHANGE\n;LAYER_CHANGE",
            "x".repeat(200_000)
        );
        assert_eq!(layer_lines(text.as_bytes()).unwrap(), [2, 5, 7]);
        assert!(layer_lines(&b""[..]).unwrap().is_empty());
    }
}
