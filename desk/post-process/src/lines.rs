//! The lines of a file of any size, with their ends as they are.

use std::io::{self, BufRead, ErrorKind};

use memchr::memchr2;

/// Maximum number of bytes of a line that are read at once; whatever is replaced is within
/// them.
const MAX_BYTES: usize = 4096;

/// The end of the bytes read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The line ends with these bytes.
    Line(&'static [u8]),
    /// The line is longer; the next call reads on.
    Unfinished,
    /// The file ends.
    File,
}

/// Reads a line, or a part of a long one, into `line`. A line ends at `\n`, `\r`, or both together,
/// as for the printer's reader of lines.
///
/// # Errors
/// The file cannot be read.
pub fn read_line(input: &mut impl BufRead, line: &mut Vec<u8>) -> io::Result<End> {
    line.clear();
    loop {
        let room = MAX_BYTES.saturating_sub(line.len());
        if room == 0 {
            return Ok(End::Unfinished);
        }
        let bytes = filled(input)?;
        if bytes.is_empty() {
            return Ok(End::File);
        }
        let bytes = bytes.get(..room).unwrap_or(bytes);
        let Some(end) = memchr2(b'\n', b'\r', bytes) else {
            let length = bytes.len();
            line.extend_from_slice(bytes);
            input.consume(length);
            continue;
        };
        line.extend_from_slice(bytes.get(..end).unwrap_or_default());
        let is_return = bytes.get(end) == Some(&b'\r');
        input.consume(end + 1);
        if !is_return {
            return Ok(End::Line(b"\n"));
        }
        if filled(input)?.first() != Some(&b'\n') {
            return Ok(End::Line(b"\r"));
        }
        input.consume(1);
        return Ok(End::Line(b"\r\n"));
    }
}

/// The bytes that are in the buffer; none at the end of the file.
fn filled(input: &mut impl BufRead) -> io::Result<&[u8]> {
    while let Err(error) = input.fill_buf() {
        if error.kind() != ErrorKind::Interrupted {
            return Err(error);
        }
    }
    input.fill_buf()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::io::BufReader;

    use super::*;

    #[test]
    fn all_ends_in_buffers_of_all_sizes() {
        let text = b"a\r\nb\r\rc\n\n\r\nd";
        let expected: [(&[u8], End); 8] = [
            (b"a", End::Line(b"\r\n")),
            (b"b", End::Line(b"\r")),
            (b"", End::Line(b"\r")),
            (b"c", End::Line(b"\n")),
            (b"", End::Line(b"\n")),
            (b"", End::Line(b"\r\n")),
            (b"d", End::File),
            (b"", End::File),
        ];
        for size in 1..=text.len() {
            let mut input = BufReader::with_capacity(size, &text[..]);
            let mut line = Vec::new();
            for (bytes, end) in expected {
                assert_eq!((read_line(&mut input, &mut line).unwrap(), &line[..]), (end, bytes), "{size}");
            }
        }
    }

    #[test]
    fn a_long_line_comes_in_parts() {
        let text = [&[b'x'; 2 * MAX_BYTES][..], b"y\n"].concat();
        let (mut input, mut line) = (&text[..], Vec::new());
        for (length, end) in [(MAX_BYTES, End::Unfinished), (MAX_BYTES, End::Unfinished), (1, End::Line(b"\n"))] {
            assert_eq!((read_line(&mut input, &mut line).unwrap(), line.len()), (end, length));
        }
    }
}
