//! Bytes to lines, in portions of any size.

use crate::line::{ChecksumScan, LINE_CAPACITY, number_word, take_apart, take_apart_cut};
use crate::{Checksum, Line, LineError};

/// Mark that some editors write at the start of a UTF-8 file.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Cuts a stream of bytes into [`Line`]s.
///
/// `\n`, `\r` or both together end a line. Empty lines and lines with only a `;` comment are
/// counted, but not returned. Comments may have any length and contain any bytes.
///
/// ```
/// use ferrostep_gcode::LineReader;
///
/// let mut reader = LineReader::new();
/// let mut rest: &[u8] = b"; start\r\nG28 ; home\r\nG1 X5";
/// let mut seen = Vec::new();
/// while !rest.is_empty() {
///     let (consumed, line) = reader.feed(rest);
///     rest = &rest[consumed..];
///     if let Some(Ok(line)) = line {
///         seen.push((line.line_number, line.text.to_owned()));
///     }
/// }
/// if let Some(Ok(line)) = reader.finish() {
///     seen.push((line.line_number, line.text.to_owned()));
/// }
/// assert_eq!(seen, [(2, "G28".to_owned()), (3, "G1 X5".to_owned())]);
/// ```
#[derive(Clone, Debug)]
pub struct LineReader {
    /// The received part of an unfinished line.
    buffer: [u8; LINE_CAPACITY],
    length: usize,
    /// The whole of a line that is too long for the buffer.
    too_long: Option<ChecksumScan>,
    comment: Comment,
    /// The last byte was a `\r` that ended a line: a following `\n` belongs to it.
    after_carriage_return: bool,
    lines_ended: u32,
}

/// State of the unfinished line.
#[derive(Clone, Copy, Debug)]
enum Comment {
    /// No `;` yet.
    NotYet,
    /// Inside a comment that cannot contain the line's checksum.
    Skipped,
    /// Inside the comment of a numbered line without a `*` so far.
    Scanned(ChecksumScan),
}

impl Comment {
    /// The state just after the `;` that follows `text`, of which `scan` has seen more
    /// if it is not all.
    fn begin(text: &[u8], scan: Option<ChecksumScan>) -> Self {
        if number_word(text).is_none() {
            return Comment::Skipped;
        }
        let mut scan = scan.unwrap_or_else(|| scanned(text));
        if scan.has_star() {
            return Comment::Skipped;
        }
        scan.extend(b";");
        Comment::Scanned(scan)
    }

    fn extend(&mut self, bytes: &[u8]) {
        if let Comment::Scanned(scan) = self {
            scan.extend(bytes);
        }
    }

    /// A host that sends comments puts the checksum after them; a `*` in a comment that is not a
    /// checksum means nothing.
    fn checksum(&self) -> Checksum {
        match self {
            Comment::NotYet | Comment::Skipped => Checksum::Absent,
            Comment::Scanned(scan) => match scan.verdict() {
                Checksum::Malformed => Checksum::Absent,
                verdict => verdict,
            },
        }
    }
}

/// A line whose end has been found.
#[derive(Clone, Copy)]
struct Ended {
    /// Length of its text in the buffer, or from the start of the bytes given to
    /// [`LineReader::advance`].
    length: usize,
    in_buffer: bool,
    plain: bool,
    /// The whole of a line that is too long.
    too_long: Option<ChecksumScan>,
    in_comment: Checksum,
}

impl Default for LineReader {
    fn default() -> Self {
        Self::new()
    }
}

impl LineReader {
    /// A reader at the start of line 1.
    pub const fn new() -> Self {
        LineReader {
            buffer: [0; LINE_CAPACITY],
            length: 0,
            too_long: None,
            comment: Comment::NotYet,
            after_carriage_return: false,
            lines_ended: 0,
        }
    }

    /// Physical lines that have ended so far, blank ones included.
    pub const fn lines_ended(&self) -> u32 {
        self.lines_ended
    }

    /// Reads up to the end of the next line that is not empty.
    ///
    /// Returns how many of `bytes` are consumed and, if its end was reached, that line. Without a
    /// line all bytes have been consumed; with one, call again with the rest.
    ///
    /// # Errors
    ///
    /// [`LineError`] in place of a line that cannot be used; the next call continues with
    /// the line after it.
    pub fn feed<'a>(&'a mut self, bytes: &'a [u8]) -> (usize, Option<Result<Line<'a>, LineError>>) {
        let mut start = 0;
        while let Some(rest) = bytes.get(start..)
            && !rest.is_empty()
        {
            let (consumed, ended) = self.advance(rest);
            let line_start = start;
            start += consumed;
            let Some(ended) = ended else { continue };
            let text_is_blank = {
                let text = if ended.in_buffer { &self.buffer[..] } else { rest };
                is_blank(text.get(..ended.length).unwrap_or_default(), self.lines_ended)
            };
            if text_is_blank && ended.too_long.is_none() {
                continue;
            }
            let text = if ended.in_buffer {
                self.buffer.get(..ended.length)
            } else {
                bytes.get(line_start..line_start + ended.length)
            };
            return (start, Some(hand_out(text.unwrap_or_default(), ended, self.lines_ended)));
        }
        (bytes.len(), None)
    }

    /// The last line, if the stream ended without a line end; the reader is then at the start
    /// of the next line.
    ///
    /// # Errors
    ///
    /// As [`LineReader::feed`].
    pub fn finish(&mut self) -> Option<Result<Line<'_>, LineError>> {
        self.after_carriage_return = false;
        if self.length == 0 && self.too_long.is_none() && matches!(self.comment, Comment::NotYet) {
            return None;
        }
        let ended = self.end_buffered();
        let text = self.buffer.get(..ended.length).unwrap_or_default();
        if is_blank(text, self.lines_ended) && ended.too_long.is_none() {
            return None;
        }
        Some(hand_out(text, ended, self.lines_ended))
    }

    /// Drops the unfinished line, whose rest was lost; the next byte begins a new line.
    pub fn break_off(&mut self) -> LineError {
        let ended = self.end_buffered();
        self.after_carriage_return = false;
        let text = self.buffer.get(..ended.length).unwrap_or_default();
        LineError::Incomplete { line_number: self.lines_ended, numbered: number_word(text).is_some() }
    }

    /// Consumes some of `bytes`, which are not empty: at least one, at most to the end of a line.
    fn advance(&mut self, bytes: &[u8]) -> (usize, Option<Ended>) {
        if self.after_carriage_return {
            self.after_carriage_return = false;
            if bytes.first() == Some(&b'\n') {
                return (1, None);
            }
        }
        if !matches!(self.comment, Comment::NotYet) {
            return self.advance_in_comment(bytes);
        }
        let (length, plain) = scan_text(bytes);
        let text = bytes.get(..length).unwrap_or_default();
        let whole_line_so_far = self.length == 0 && self.too_long.is_none();
        match bytes.get(length) {
            None => {
                self.push(text);
                (length, None)
            }
            Some(b';') => {
                let after = bytes.get(length + 1..).unwrap_or_default();
                if whole_line_so_far && let Some(comment_length) = find_line_end(after) {
                    let mut comment = Comment::begin(text, None);
                    comment.extend(after.get(..comment_length).unwrap_or_default());
                    let end = length + 1 + comment_length;
                    self.count_line(bytes.get(end));
                    return (end + 1, Some(Ended::in_slice(text, plain, comment.checksum())));
                }
                self.push(text);
                self.comment = Comment::begin(self.buffer.get(..self.length).unwrap_or_default(), self.too_long);
                (length + 1, None)
            }
            Some(line_end) => {
                if whole_line_so_far {
                    self.count_line(Some(line_end));
                    return (length + 1, Some(Ended::in_slice(text, plain, Checksum::Absent)));
                }
                self.push(text);
                let ended = self.end_buffered();
                self.after_carriage_return = *line_end == b'\r';
                (length + 1, Some(ended))
            }
        }
    }

    fn advance_in_comment(&mut self, bytes: &[u8]) -> (usize, Option<Ended>) {
        let Some(length) = find_line_end(bytes) else {
            self.comment.extend(bytes);
            return (bytes.len(), None);
        };
        self.comment.extend(bytes.get(..length).unwrap_or_default());
        let ended = self.end_buffered();
        self.after_carriage_return = bytes.get(length) == Some(&b'\r');
        (length + 1, Some(ended))
    }

    fn push(&mut self, text: &[u8]) {
        let room = LINE_CAPACITY - self.length;
        let (kept, dropped) = text.split_at(text.len().min(room));
        let end = self.length + kept.len();
        if let Some(place) = self.buffer.get_mut(self.length..end) {
            place.copy_from_slice(kept);
        }
        self.length = end;
        if !dropped.is_empty() {
            self.too_long.get_or_insert_with(|| scanned(&self.buffer)).extend(dropped);
        }
    }

    /// Ends the line in the buffer, which keeps its bytes until something is pushed.
    fn end_buffered(&mut self) -> Ended {
        let ended = Ended {
            length: self.length,
            in_buffer: true,
            plain: false,
            too_long: self.too_long,
            in_comment: self.comment.checksum(),
        };
        self.length = 0;
        self.too_long = None;
        self.comment = Comment::NotYet;
        self.count_line(None);
        ended
    }

    fn count_line(&mut self, line_end: Option<&u8>) {
        self.lines_ended = self.lines_ended.saturating_add(1);
        self.after_carriage_return = line_end == Some(&b'\r');
    }
}

impl Ended {
    fn in_slice(text: &[u8], plain: bool, in_comment: Checksum) -> Self {
        let too_long = (text.len() > LINE_CAPACITY).then(|| scanned(text));
        Ended { length: text.len(), in_buffer: false, plain, too_long, in_comment }
    }
}

fn scanned(text: &[u8]) -> ChecksumScan {
    let mut scan = ChecksumScan::new();
    scan.extend(text);
    scan
}

fn hand_out(text: &[u8], ended: Ended, line_number: u32) -> Result<Line<'_>, LineError> {
    if let Some(scan) = ended.too_long {
        // Keeps the same bytes whether the line came whole or in portions.
        let kept = text.get(..LINE_CAPACITY).unwrap_or(text);
        let checksum = if scan.has_star() { scan.verdict() } else { ended.in_comment };
        return take_apart_cut(kept, line_number, checksum);
    }
    let text = if line_number == 1 { without_byte_order_mark(text) } else { text };
    take_apart(text, ended.plain, line_number, ended.in_comment)
}

fn without_byte_order_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text)
}

fn is_blank(text: &[u8], line_number: u32) -> bool {
    let text = if line_number == 1 { without_byte_order_mark(text) } else { text };
    text.iter().all(|&byte| byte == b' ' || byte == b'\t')
}

const ENDS_TEXT: u8 = 1;
const NOT_PLAIN: u8 = 2;

/// The class of each byte for [`scan_text`].
static BYTE_CLASS: [u8; 256] = {
    let mut class = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        class[byte] = match byte as u8 {
            b'\n' | b'\r' | b';' => ENDS_TEXT,
            b'\t' | b' '..=b'~' => 0,
            _ => NOT_PLAIN,
        };
        byte += 1;
    }
    class
};

/// Length of the text before a line end, a comment or the end of `bytes`, and whether all of it is
/// printable ASCII.
fn scan_text(bytes: &[u8]) -> (usize, bool) {
    let mut plain = true;
    for (at, &byte) in bytes.iter().enumerate() {
        match BYTE_CLASS[usize::from(byte)] {
            0 => {}
            ENDS_TEXT => return (at, plain),
            _ => plain = false,
        }
    }
    (bytes.len(), plain)
}

fn find_line_end(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|&byte| byte == b'\n' || byte == b'\r')
}

#[cfg(test)]
mod tests;
