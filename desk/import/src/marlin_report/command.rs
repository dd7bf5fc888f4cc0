//! Commands of a report, and values of the answer to M115.

/// A command of the report.
pub(super) struct Command<'a> {
    pub(super) line: usize,
    /// The letter and number.
    pub(super) code: &'a str,
    /// All after the code, without its comment.
    pub(super) rest: &'a str,
}

impl Command<'_> {
    /// The number after a letter.
    pub(super) fn number(&self, letter: char) -> Option<f64> {
        let mut words = self.rest.split_whitespace();
        let text = words.find_map(|word| word.strip_prefix(letter))?;
        text.parse().ok().filter(|number: &f64| number.is_finite())
    }

    pub(super) fn has(&self, letter: char) -> bool {
        self.rest.split_whitespace().any(|word| word.starts_with(letter))
    }

    /// Returns true for the first extruder, heater or motor, by the letter that names it.
    pub(super) fn is_of_first(&self, letters: &[char]) -> bool {
        letters.iter().all(|letter| !self.has(*letter) || self.number(*letter) == Some(0.0))
    }
}

/// Returns the text after a key in the answer to M115, up to the next key.
pub(super) fn value_of(about: &[String], key: &str) -> Option<String> {
    let is_key = |word: &&str| {
        let key = word.split(':').next().unwrap_or_default();
        word.contains(':') && key.len() > 2 && key.bytes().all(|byte| byte.is_ascii_uppercase() || byte == b'_')
    };
    let rest = about.iter().find_map(|line| line.split_once(key).map(|(_, rest)| rest))?;
    let words: Vec<&str> = rest.split_whitespace().take_while(|word| !is_key(word)).collect();
    Some(words.join(" ")).filter(|value| !value.is_empty())
}

/// The command of a line, if it is one: `echo:  M92 X80.00 ...`.
pub(super) fn command(line: usize, text: &str) -> Option<Command<'_>> {
    let text = ["echo:", "Config:"].iter().find_map(|start| text.trim().strip_prefix(start)).unwrap_or(text).trim();
    let text = text.split(';').next().unwrap_or_default().trim();
    let (code, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    let digits = code.strip_prefix(['M', 'G'])?;
    let is_code = !digits.is_empty() && digits.len() < 5 && digits.bytes().all(|byte| byte.is_ascii_digit());
    // The printer repeats the command where it echoes.
    (is_code && code != super::M503).then_some(Command { line, code, rest: rest.trim() })
}
