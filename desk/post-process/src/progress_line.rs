//! Lines with M73, the progress that a slicer tells the printer.

use std::ops::Range;

use crate::moment::Moment;

/// The most decimals of a word.
const MAX_DECIMALS: usize = 6;

/// A word of a line: its letter, and the place of its number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Word {
    /// The word's letter, as it is written.
    pub letter: u8,
    /// The place of its number in the line, bytes.
    pub number: Range<usize>,
}

/// The words of a line whose command is M73; `None` for other lines.
pub fn words(line: &[u8]) -> Option<Vec<Word>> {
    let mut at = after_number(line);
    if !matches!(line.get(at), Some(b'M' | b'm')) {
        return None;
    }
    at = skip_blanks(line, at + 1);
    let code = digits(line, at);
    let text = line.get(code.clone()).unwrap_or_default();
    let zeros = text.iter().take_while(|byte| **byte == b'0').count();
    if text.get(zeros..) != Some(b"73") {
        return None;
    }
    at = code.end;
    let mut words = Vec::new();
    loop {
        at = skip_blanks(line, at);
        let Some(letter) = line.get(at).copied().filter(u8::is_ascii_alphabetic) else { return Some(words) };
        let start = skip_blanks(line, at + 1);
        let number = start..digits(line, start).end;
        at = number.end;
        words.push(Word { letter, number });
    }
}

/// Returns true if words tell how far the print is, or how long it still takes.
pub fn tells_progress(words: &[Word]) -> bool {
    words.iter().any(|word| matches!(word.letter, b'P' | b'p' | b'R' | b'r'))
}

/// Returns true if a line begins with its number, as in the conversation with a host.
pub fn is_numbered(line: &[u8]) -> bool {
    after_number(line) > skip_blanks(line, 0)
}

/// The line with a moment in its words; its other bytes stay, but for the checksum of a numbered
/// line.
pub fn with_moment(line: &[u8], words: &[Word], moment: &Moment) -> Vec<u8> {
    let (mut text, mut copied) = (Vec::with_capacity(line.len() + 8), 0);
    for Word { letter, number } in words {
        let old = line.get(number.clone()).unwrap_or_default();
        let decimals = old.iter().position(|byte| *byte == b'.').map_or(0, |point| old.len() - point - 1);
        let Some(new) = moment.word(*letter, decimals.min(MAX_DECIMALS)).filter(|_| !old.is_empty()) else { continue };
        text.extend_from_slice(line.get(copied..number.start).unwrap_or_default());
        text.extend_from_slice(new.as_bytes());
        copied = number.end;
    }
    text.extend_from_slice(line.get(copied..).unwrap_or_default());
    if is_numbered(&text) {
        renew_checksum(&mut text);
    }
    text
}

/// Writes the checksum of a line in place of the one it has: the XOR of the bytes before the `*`.
fn renew_checksum(line: &mut Vec<u8>) {
    let Some(star) = line.iter().rposition(|byte| *byte == b'*') else { return };
    let place = digits(line, star + 1);
    let sum = line.iter().take(star).fold(0, |sum, byte| sum ^ byte);
    if !place.is_empty() {
        line.splice(place, sum.to_string().into_bytes());
    }
}

/// The place after a line's number, or of its first byte but blanks.
fn after_number(line: &[u8]) -> usize {
    let start = skip_blanks(line, 0);
    if !matches!(line.get(start), Some(b'N' | b'n')) {
        return start;
    }
    let number = skip_blanks(line, start + 1);
    let number = number + usize::from(line.get(number) == Some(&b'-'));
    let end = digits(line, number).end;
    if end == number { start } else { skip_blanks(line, end) }
}

/// The digits from a place on, with a decimal point.
fn digits(line: &[u8], start: usize) -> Range<usize> {
    let rest = line.get(start..).unwrap_or_default();
    start..start + rest.iter().take_while(|byte| byte.is_ascii_digit() || **byte == b'.').count()
}

fn skip_blanks(line: &[u8], start: usize) -> usize {
    let rest = line.get(start..).unwrap_or_default();
    start + rest.iter().take_while(|byte| matches!(byte, b' ' | b'\t')).count()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const MOMENT: Moment = Moment { elapsed_s: 300.0, total_s: 1200.0, to_pause_s: Some(120.0) };

    #[test]
    fn words_take_the_moment_in_their_own_form() {
        for (line, expected) in [
            ("M73 P0 R21", "M73 P25 R15"),
            ("M73 Q99 S0", "M73 Q25 S15"),
            ("M73 C10", "M73 C2"),
            ("M73 D10.55", "M73 D2.00"),
            ("  m73 p1 r1 ; P5 R6 \u{e9}", "  m73 p25 r15 ; P5 R6 \u{e9}"),
            ("M073 P 12.125 R3", "M073 P 25.000 R15"),
            ("M73P1R2", "M73P25R15"),
            ("M73", "M73"),
            ("M73 P", "M73 P"),
            ("M73 B5 P1", "M73 B5 P25"),
            ("N1 M73 P0 R21*39", "N1 M73 P25 R15*23"),
            ("N1 M73 P0 R21", "N1 M73 P25 R15"),
        ] {
            let found = words(line.as_bytes()).unwrap_or_else(|| panic!("{line}"));
            let text = String::from_utf8(with_moment(line.as_bytes(), &found, &MOMENT)).unwrap();
            assert_eq!(text, expected, "{line}");
        }
    }

    #[test]
    fn the_word_for_a_pause_stays_where_none_comes() {
        let line = b"M73 P1 C10";
        let moment = Moment { to_pause_s: None, ..MOMENT };
        assert_eq!(with_moment(line, &words(line).unwrap(), &moment), b"M73 P25 C10");
    }

    #[test]
    fn other_lines() {
        for line in ["", ";M73 P1", "M730", "M7 P3", "M73.1 P3", "G1 X73", "N M73", "N5", "M", "(M73 P1)"] {
            assert_eq!(words(line.as_bytes()), None, "{line}");
        }
        assert!(is_numbered(b" N-1 M110"));
        assert!(!is_numbered(b"N M110") && !is_numbered(b"M110 N3"));
        for (line, tells) in [("M73 P1", true), ("M73 r1", true), ("M73 Q1 S1 C4", false), ("M73", false)] {
            assert_eq!(tells_progress(&words(line.as_bytes()).unwrap()), tells, "{line}");
        }
    }
}
