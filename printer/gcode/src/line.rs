//! One line of input: its number, its checksum, its text.

use core::fmt;

use crate::{Command, parse};

/// Maximum length of a line in bytes, from its start to its comment or its end. Longer lines are
/// refused, but for those whose text is for people (M117, M118) and named commands without effect
/// (EXCLUDE_OBJECT_DEFINE), of which the rest is dropped.
pub const LINE_CAPACITY: usize = 256;

/// One line, taken apart but not yet read as a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line<'a> {
    /// Number of the physical line in the file or stream, from 1.
    pub line_number: u32,
    /// The command: without comment, line number, checksum and surrounding blanks.
    ///
    /// Empty only if the line is a line number alone.
    pub text: &'a str,
    /// The `N` word at the start; beyond the range of `i64` it is the nearest end of that range.
    pub number: Option<i64>,
    /// Result of the checksum; always [`Checksum::Absent`] without an `N` word, because a `*` then
    /// belongs to the text.
    pub checksum: Checksum,
}

/// The checksum of a numbered line: the XOR of its bytes before the `*`, in decimal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checksum {
    /// Missing.
    Absent,
    /// The checksum agrees with the bytes.
    Right,
    /// The checksum does not agree with the bytes.
    Wrong {
        /// Checksum in the line.
        expected: u8,
        /// Checksum of its bytes.
        computed: u8,
    },
    /// The text after the `*` is not a number from 0 to 255.
    Malformed,
}

/// Reason why a line cannot be used. It is reported once, at the line's end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineError {
    /// More characters before the comment than [`LINE_CAPACITY`].
    TooLong {
        /// Number of the physical line, from 1.
        line_number: u32,
        /// The `N` word at the start.
        number: Option<i64>,
        /// Result of the whole line's checksum.
        checksum: Checksum,
    },
    /// A control character other than a tab, or bytes that are not UTF-8, before the comment.
    NotText {
        /// Number of the physical line, from 1.
        line_number: u32,
        /// The first such byte.
        byte: u8,
        /// The `N` word at the start.
        number: Option<i64>,
        /// Result of the checksum, also without an `N` word.
        checksum: Checksum,
    },
    /// Part of the line was lost on its way.
    Incomplete {
        /// Number of the physical line, from 1.
        line_number: u32,
        /// True if the line begins with an `N` word, so that a host can be asked for it again.
        numbered: bool,
    },
}

impl LineError {
    /// Number of the physical line, from 1.
    pub const fn line_number(&self) -> u32 {
        match *self {
            LineError::TooLong { line_number, .. }
            | LineError::NotText { line_number, .. }
            | LineError::Incomplete { line_number, .. } => line_number,
        }
    }

    /// The number of a line that has come whole, as its checksum shows: it would be the same if the
    /// host sent it again.
    pub(crate) const fn number_of_whole_line(&self) -> Option<i64> {
        match *self {
            LineError::TooLong { number, checksum: Checksum::Right, .. }
            | LineError::NotText { number, checksum: Checksum::Right, .. } => number,
            _ => None,
        }
    }

    /// True for a line without an `N` word that contains a byte other than text and ends in
    /// a wrong checksum.
    pub(crate) const fn has_lost_its_number(&self) -> bool {
        matches!(self, LineError::NotText { number: None, checksum: Checksum::Wrong { .. }, .. })
    }

    /// True if the line begins with an `N` word, so that a host can be asked for it again.
    pub const fn is_numbered(&self) -> bool {
        match *self {
            LineError::TooLong { number, .. } | LineError::NotText { number, .. } => number.is_some(),
            LineError::Incomplete { numbered, .. } => numbered,
        }
    }
}

impl fmt::Display for LineError {
    /// Writes the error without the line's number.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LineError::TooLong { .. } => {
                write!(formatter, "the line is too long, expected at most {} characters", LINE_CAPACITY)
            }
            LineError::NotText { byte, .. } => {
                write!(formatter, "not text: byte 0x{byte:02x}, expected UTF-8 without control characters")
            }
            LineError::Incomplete { .. } => {
                formatter.write_str("part of the line was lost; send each line after the answer to the one before")
            }
        }
    }
}

impl core::error::Error for LineError {}

/// The XOR of the bytes so far, and what the last `*` among them introduces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChecksumScan {
    xor: u8,
    xor_before_star: u8,
    tail: Tail,
}

/// Text read since the last `*`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tail {
    NoStar,
    Star,
    Digits(u8),
    DigitsThenBlanks(u8),
    Malformed,
}

impl ChecksumScan {
    pub(crate) const fn new() -> Self {
        ChecksumScan { xor: 0, xor_before_star: 0, tail: Tail::NoStar }
    }

    pub(crate) fn extend(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.tail = match (self.tail, byte) {
                (_, b'*') => {
                    self.xor_before_star = self.xor;
                    Tail::Star
                }
                (Tail::NoStar, _) => Tail::NoStar,
                (Tail::Star, b'0'..=b'9') => Tail::Digits(byte - b'0'),
                (Tail::Digits(value), b'0'..=b'9') => {
                    match value.checked_mul(10).and_then(|tens| tens.checked_add(byte - b'0')) {
                        Some(value) => Tail::Digits(value),
                        None => Tail::Malformed,
                    }
                }
                (Tail::Digits(value) | Tail::DigitsThenBlanks(value), b' ' | b'\t') => Tail::DigitsThenBlanks(value),
                _ => Tail::Malformed,
            };
            self.xor ^= byte;
        }
    }

    pub(crate) fn has_star(&self) -> bool {
        self.tail != Tail::NoStar
    }

    pub(crate) fn verdict(&self) -> Checksum {
        match self.tail {
            Tail::NoStar => Checksum::Absent,
            Tail::Star | Tail::Malformed => Checksum::Malformed,
            Tail::Digits(expected) | Tail::DigitsThenBlanks(expected) => {
                let computed = self.xor_before_star;
                if expected == computed { Checksum::Right } else { Checksum::Wrong { expected, computed } }
            }
        }
    }
}

/// The `N` word at the start of a line, and where the rest begins.
pub(crate) fn number_word(text: &[u8]) -> Option<(i64, usize)> {
    let mut at = skip_blanks(text, 0);
    if !matches!(text.get(at), Some(b'N' | b'n')) {
        return None;
    }
    at = skip_blanks(text, at + 1);
    let negative = text.get(at) == Some(&b'-');
    if negative {
        at += 1;
    }
    let start = at;
    let mut value: i64 = 0;
    while let Some(&byte @ b'0'..=b'9') = text.get(at) {
        let digit = i64::from(byte - b'0');
        value = value.saturating_mul(10);
        value = if negative { value.saturating_sub(digit) } else { value.saturating_add(digit) };
        at += 1;
    }
    (at > start).then_some((value, at))
}

fn skip_blanks(text: &[u8], mut at: usize) -> usize {
    while matches!(text.get(at), Some(b' ' | b'\t')) {
        at += 1;
    }
    at
}

/// The text before the first byte that is not text, and that byte, if any.
fn text_before(bytes: &[u8]) -> (&str, Option<u8>) {
    let valid = match core::str::from_utf8(bytes) {
        Ok(_) => bytes.len(),
        Err(error) => error.valid_up_to(),
    };
    let is_control = |&byte: &u8| byte.is_ascii_control() && byte != b'\t';
    let end = bytes.iter().take(valid).position(is_control).unwrap_or(valid);
    let text = bytes.get(..end).and_then(|text| core::str::from_utf8(text).ok()).unwrap_or_default();
    (text, bytes.get(end).copied())
}

/// True if a command is M117 or M118, whose text may be cut.
fn is_message(command: &[u8]) -> bool {
    let Some((b'M' | b'm', rest)) = command.split_first() else { return false };
    let digits = rest.get(skip_blanks(rest, 0)..).unwrap_or_default();
    let zeros = digits.iter().take_while(|&&byte| byte == b'0').count();
    match digits.get(zeros..) {
        Some([b'1', b'1', b'7' | b'8', after @ ..]) => !matches!(after.first(), Some(b'0'..=b'9' | b'.')),
        _ => false,
    }
}

/// True if a text begins with a command's name, of several letters, that has no effect whatever its
/// words are: outlines of objects have thousands of characters.
fn has_no_effect(text: &str) -> bool {
    let is_name =
        matches!(text.as_bytes(), [first, second, ..] if first.is_ascii_alphabetic() && second.is_ascii_alphabetic());
    is_name && matches!(parse(text), Ok(Command::Accepted | Command::Unknown(_)))
}

/// Splits a line into number, text and checksum. `bytes` is everything before the comment, `plain`
/// promises that it is printable ASCII, `in_comment` is the checksum found in the comment.
pub(crate) fn take_apart<'a>(
    bytes: &'a [u8],
    plain: bool,
    line_number: u32,
    in_comment: Checksum,
) -> Result<Line<'a>, LineError> {
    let (number, command, checksum) = match number_word(bytes) {
        None => (None, bytes, Checksum::Absent),
        Some((number, start)) => {
            let mut scan = ChecksumScan::new();
            scan.extend(bytes);
            let star = bytes.iter().rposition(|&byte| byte == b'*').unwrap_or(bytes.len());
            let command = bytes.get(start..star).unwrap_or_default();
            (Some(number), command, if scan.has_star() { scan.verdict() } else { in_comment })
        }
    };
    let not_text = |byte: u8| {
        // Without a number, the checksum tells a damaged line of a host's conversation.
        let mut scan = ChecksumScan::new();
        scan.extend(bytes);
        let checksum = if number.is_none() && scan.has_star() { scan.verdict() } else { checksum };
        LineError::NotText { line_number, byte, number, checksum }
    };
    let command = trim(command);
    if !plain
        && let (_, Some(byte)) = text_before(bytes)
        && !is_message(command)
    {
        return Err(not_text(byte));
    }
    let text = if plain {
        // Cut at ASCII bytes, text stays text.
        core::str::from_utf8(command).map_err(|_| not_text(0xff))?
    } else {
        text_before(command).0.trim_end_matches([' ', '\t'])
    };
    Ok(Line { line_number, text, number, checksum })
}

/// Takes a line apart that is too long, of which `kept` is the beginning.
pub(crate) fn take_apart_cut(kept: &[u8], line_number: u32, checksum: Checksum) -> Result<Line<'_>, LineError> {
    let (number, start) = number_word(kept).map_or((None, 0), |(number, start)| (Some(number), start));
    let command = trim(kept.get(start..).unwrap_or_default());
    let checksum = if number.is_some() { checksum } else { Checksum::Absent };
    if is_message(command) || has_no_effect(text_before(command).0) {
        return Ok(Line { line_number, text: text_before(command).0.trim_end_matches([' ', '\t']), number, checksum });
    }
    Err(LineError::TooLong { line_number, number, checksum })
}

/// `bytes` without the spaces and tabs around them.
fn trim(mut bytes: &[u8]) -> &[u8] {
    while let [b' ' | b'\t', rest @ ..] = bytes {
        bytes = rest;
    }
    while let [rest @ .., b' ' | b'\t'] = bytes {
        bytes = rest;
    }
    bytes
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn line(text: &str) -> Line<'_> {
        take_apart(text.as_bytes(), false, 1, Checksum::Absent).unwrap()
    }

    #[test]
    fn checksums_of_the_protocol() {
        for (text, number, command) in [
            ("N3 T0*57", 3, "T0"),
            ("N4 G92 E0*67", 4, "G92 E0"),
            ("N0 M110 N0*125", 0, "M110 N0"),
            ("N-1 M110 N-1*125", -1, "M110 N-1"),
            ("N1 M73 P0 R21*39 ", 1, "M73 P0 R21"),
            ("N24 G1 Z2.0 F3000*45", 24, "G1 Z2.0 F3000"),
        ] {
            let line = line(text);
            assert_eq!(line.number, Some(number), "{text}");
            assert_eq!(line.text, command, "{text}");
            assert_eq!(line.checksum, Checksum::Right, "{text}");
        }
    }

    #[test]
    fn checksums_that_fail() {
        assert_eq!(line("N3 T0*56").checksum, Checksum::Wrong { expected: 56, computed: 57 });
        assert_eq!(line("N3 T0").checksum, Checksum::Absent);
        for text in ["N3 T0*", "N3 T0*x", "N3 T0*300", "N3 T0*-5", "N3 T0*5 7", "N3 T0* 57"] {
            assert_eq!(line(text).checksum, Checksum::Malformed, "{text}");
            assert_eq!(line(text).text, "T0");
        }
        // The last `*` counts.
        let last = line("N5 M117 20*3*0");
        assert_eq!(last.text, "M117 20*3");
        assert!(matches!(last.checksum, Checksum::Wrong { expected: 0, .. }));
    }

    #[test]
    fn a_star_without_a_number_is_text() {
        let line = line("  M117 20*3 ");
        assert_eq!((line.text, line.number, line.checksum), ("M117 20*3", None, Checksum::Absent));
    }

    #[test]
    fn number_words() {
        assert_eq!(number_word(b" n12G1"), Some((12, 4)));
        assert_eq!(number_word(b"N 12 G1"), Some((12, 4)));
        assert_eq!(number_word(b"N99999999999999999999"), Some((i64::MAX, 21)));
        assert_eq!(number_word(b"N-99999999999999999999"), Some((i64::MIN, 22)));
        for text in ["N", "N G1", "NX", "N-", "G1 N5", ""] {
            assert_eq!(number_word(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn bytes_that_are_not_text() {
        let refused = |bytes: &[u8]| take_apart(bytes, false, 7, Checksum::Absent).unwrap_err();
        let not_text = |byte, number| LineError::NotText { line_number: 7, byte, number, checksum: Checksum::Absent };
        assert_eq!(refused(b"G1\0"), not_text(0, None));
        assert_eq!(refused(b"N5 \x7f"), not_text(0x7f, Some(5)));
        assert_eq!(
            refused(b"M119 \xff\x01").to_string(),
            "not text: byte 0xff, expected UTF-8 without control characters"
        );
        assert_eq!(
            refused(b"M1170 \x01\xff").to_string(),
            "not text: byte 0x01, expected UTF-8 without control characters"
        );
        assert_eq!(line("M117\tGr\u{fc}\u{df}e").text, "M117\tGr\u{fc}\u{df}e");
        // A message loses bytes that are not text; it is not requested again, and no job stops.
        let message = |bytes: &'static [u8]| take_apart(bytes, false, 7, Checksum::Absent).unwrap();
        assert_eq!(message(b"M117 Gr\xfc\xdfe").text, "M117 Gr");
        assert_eq!(message(b"m 0118 Gr\x01e").text, "m 0118 Gr");
        assert_eq!(
            message(b"N5 M117 \xe4*3"),
            Line {
                line_number: 7,
                text: "M117",
                number: Some(5),
                checksum: Checksum::Wrong { expected: 3, computed: 229 }
            }
        );
    }
}
