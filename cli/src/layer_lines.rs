//! The lines at which a file's layers begin, by the slicer's comments.

use std::io::{self, BufRead, BufReader, Read};

use crate::comments::Comments;

/// Reads a file to its end; the line of each layer's beginning, from 1.
///
/// # Errors
/// It cannot be read.
pub fn layer_lines(input: impl Read) -> io::Result<Vec<u32>> {
    let (mut comments, mut found, mut line) = (Comments::default(), Vec::new(), 0);
    let mut input = BufReader::new(input);
    let mut text = Vec::new();
    loop {
        text.clear();
        // The longest line that is read has a fixed length; of a longer one the rest counts as another read.
        if input.by_ref().take(1 << 16).read_until(b'\n', &mut text)? == 0 {
            break;
        }
        let (before, ends) = (comments.layers, text.last() == Some(&b'\n'));
        comments.read(&text);
        line += u32::from(ends);
        if comments.layers > before {
            found.push(line);
        }
    }
    let before = comments.layers;
    comments.end();
    if comments.layers > before {
        found.push(line + 1);
    }
    Ok(found)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn layers_begin_at_their_comments() {
        let text =
            format!("; begin\n;LAYER_CHANGE\nG1 X1\n;{}\n;LAYER:1\nG1 X2 ;LAYER:9\n;LAYER_CHANGE", "x".repeat(200_000));
        assert_eq!(layer_lines(text.as_bytes()).unwrap(), [2, 5, 7]);
        assert!(layer_lines(&b""[..]).unwrap().is_empty());
    }
}
