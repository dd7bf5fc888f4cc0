//! The comments at the start of lines, in a stream of portions of any size.

use memchr::memchr2;

/// Maximum number of bytes kept of a comment: the longest that is read is a slicer's time in words.
const KEPT_BYTES: usize = 160;

/// The stream's present place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Place {
    /// The start of a line, but for blanks.
    #[default]
    LineStart,
    /// A comment that began the line.
    Comment,
    /// Any other text.
    Else,
}

/// Finds the comments that begin lines. A line ends at `\n`, `\r`, or both together, as for the
/// printer's reader of lines.
#[derive(Debug, Default)]
pub struct CommentReader {
    lines_ended: u32,
    place: Place,
    after_return: bool,
    kept: Vec<u8>,
}

impl CommentReader {
    /// Reads some bytes; reports each comment and the number of its line, from 1.
    pub fn read(&mut self, portion: &[u8], mut tell: impl FnMut(u32, &str)) {
        let mut rest = portion;
        while let Some(&byte) = rest.first() {
            if std::mem::take(&mut self.after_return) && byte == b'\n' {
                rest = rest.get(1..).unwrap_or_default();
                continue;
            }
            let end = memchr2(b'\n', b'\r', rest);
            let text = rest.get(..end.unwrap_or(rest.len())).unwrap_or_default();
            self.take(text);
            let Some(end) = end else { return };
            self.after_return = rest.get(end) == Some(&b'\r');
            rest = rest.get(end + 1..).unwrap_or_default();
            self.end(&mut tell);
        }
    }

    /// Ends the last line, which needs no line end.
    pub fn end(&mut self, mut tell: impl FnMut(u32, &str)) {
        self.lines_ended = self.lines_ended.saturating_add(1);
        if self.place == Place::Comment {
            tell(self.lines_ended, &String::from_utf8_lossy(&self.kept));
        }
        self.place = Place::LineStart;
        self.kept.clear();
    }

    fn take(&mut self, mut text: &[u8]) {
        if self.place == Place::LineStart {
            while let [b' ' | b'\t', after @ ..] = text {
                text = after;
            }
            self.place = match text.first() {
                None => Place::LineStart,
                Some(b';') => Place::Comment,
                Some(_) => Place::Else,
            };
        }
        if self.place == Place::Comment {
            let room = KEPT_BYTES.saturating_sub(self.kept.len());
            self.kept.extend(text.iter().take(room));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn comments(text: &[u8], size: usize) -> Vec<(u32, String)> {
        let (mut reader, mut found) = (CommentReader::default(), Vec::new());
        text.chunks(size).for_each(|portion| reader.read(portion, |line, text| found.push((line, text.to_owned()))));
        reader.end(|line, text| found.push((line, text.to_owned())));
        found
    }

    #[test]
    fn portions_of_any_size_and_line_ends_of_all_kinds() {
        let text = b";a\r\n\n  ;b\rG1 ;c\r\r;d\n\r;e\r\n;f";
        let expected =
            [(1, ";a"), (3, ";b"), (6, ";d"), (8, ";e"), (9, ";f")].map(|(line, text)| (line, text.to_owned()));
        for size in 1..text.len() {
            assert_eq!(comments(text, size), expected, "{size}");
        }
    }

    #[test]
    fn a_long_comment_is_cut() {
        let text = format!(";{}", "x".repeat(200_000));
        assert_eq!(comments(text.as_bytes(), 4096)[0].1.len(), KEPT_BYTES);
    }
}
