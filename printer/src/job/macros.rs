//! Macros of the profile: names for lines of G-code.
//!
//! All macros are one text, which a profile's reader has checked. The first line of each is
//! `#NAME`, then a blank and a word for each parameter: `KEY=DEFAULT`, or `KEY` where a call must
//! give it. Its other lines are a place, such as `3`, a blank, and a line of G-code in which
//! `{KEY}` is replaced by the parameter. A macro that calls another contains its lines.

use ferrostep_gcode::{ParseError, ShortText};

/// Maximum number of characters of a macro's line, its parameters in their places.
pub const MACRO_LINE: usize = 96;

/// The place of no line.
const NO_PLACE: &str = "0";

/// A line of a macro, its parameters in their places.
pub(crate) type MacroLine = heapless::String<MACRO_LINE>;

/// A macro that is called.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Call<'a> {
    name: &'static str,
    /// The parameters, each with its default.
    parameters: &'static str,
    /// The lines still to come, and all of the profile's text after them.
    rest: &'static str,
    /// Place of the present line in the profile.
    place: &'static str,
    /// The words of the call.
    words: &'a str,
}

/// The value of a key in words such as `BED=60 NOZZLE=200`; `Some(None)`: a key alone.
fn value<'w>(words: &'w str, key: &str) -> Option<Option<&'w str>> {
    words.split_ascii_whitespace().find_map(|word| {
        let (known, value) = word.split_once('=').map_or((word, None), |(known, value)| (known, Some(value)));
        known.eq_ignore_ascii_case(key).then_some(value)
    })
}

/// The macro that a line calls.
pub(crate) fn call<'a>(macros: &'static str, text: &'a str) -> Option<Call<'a>> {
    // Nearly every line of a print is a letter with a number.
    let is_name = |byte: &u8| byte.is_ascii_alphabetic() || *byte == b'_';
    if macros.is_empty() || !text.as_bytes().get(..2)?.iter().all(is_name) {
        return None;
    }
    find(macros, text)
}

#[cold]
fn find<'a>(macros: &'static str, text: &'a str) -> Option<Call<'a>> {
    let (called, words) = text.split_once([' ', '\t']).unwrap_or((text, ""));
    let mut rest = macros;
    while let Some((line, after)) = rest.split_once('\n') {
        rest = after;
        let Some(head) = line.strip_prefix('#') else { continue };
        let (name, parameters) = head.split_once(' ').unwrap_or((head, ""));
        if name.eq_ignore_ascii_case(called.trim_end()) {
            return Some(Call { name, parameters, rest, place: NO_PLACE, words });
        }
    }
    None
}

impl<'a> Call<'a> {
    /// The same with these words.
    pub fn with(self, words: &'a str) -> Self {
        Self { words, ..self }
    }
}

impl Call<'_> {
    /// The macro's name.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Returns true once a line has been written.
    pub fn has_begun(&self) -> bool {
        self.place != NO_PLACE
    }

    /// The number of the present line; with the name of its macro, if that is not the called one.
    pub fn place(&self) -> &'static str {
        self.place
    }

    /// Writes the next line; `false` after the last.
    ///
    /// # Errors
    /// The call has a word that the macro does not know or lacks one, or the line becomes too long.
    // In a future the compiler would keep every value in memory.
    #[inline(never)]
    pub fn next_line(&mut self, out: &mut MacroLine) -> Result<bool, ParseError> {
        out.clear();
        if !self.has_begun() {
            self.check()?;
        }
        let Some((line, rest)) = self.rest.split_once('\n').filter(|(line, _)| !line.starts_with('#')) else {
            return Ok(false);
        };
        let (place, mut text) = line.split_once(' ').unwrap_or((line, ""));
        (self.place, self.rest) = (place, rest);
        let too_long =
            ParseError::WordsExpected { command: self.name, words: "shorter values: a line has at most 96 characters" };
        let mut put = |part: &str| out.push_str(part).map_err(|_| too_long);
        while let Some((before, (key, after))) =
            text.split_once('{').and_then(|(before, after)| Some((before, after.split_once('}')?)))
        {
            put(before)?;
            let default = value(self.parameters, key).flatten();
            put(value(self.words, key).flatten().or(default).unwrap_or_default())?;
            text = after;
        }
        put(text)?;
        Ok(true)
    }

    /// Checks the words of the call.
    fn check(&self) -> Result<(), ParseError> {
        for word in self.words.split_ascii_whitespace() {
            let (key, value_of) = word.split_once('=').unwrap_or((word, ""));
            if value_of.is_empty() || value(self.parameters, key).is_none() {
                let (word, known) = (ShortText::new(word), self.parameters);
                return Err(ParseError::UnknownParameter { command: self.name, word, known });
            }
        }
        let is_missing = |word: &str| !word.contains('=') && value(self.words, word).is_none();
        match self.parameters.split_ascii_whitespace().find(|word| is_missing(word)) {
            Some(words) => Err(ParseError::WordsExpected { command: self.name, words }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
