//! The command of a line of G-code, without its parameters.

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
