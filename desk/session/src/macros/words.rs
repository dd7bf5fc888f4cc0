//! The words of a named command, `KEY=VALUE`.

use ferrostep_gcode::Decimal;

/// The words after a command's name. Keys count in upper and lower case; a pair of quotes holds
/// blanks together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Words<'a>(&'a str);

impl<'a> Words<'a> {
    /// The words of a line.
    pub fn of(text: &'a str) -> Self {
        Self(text.split_once([' ', '\t']).map_or("", |(_, words)| words))
    }

    /// The keys and their values, without quotes.
    pub fn pairs(self) -> impl Iterator<Item = (&'a str, &'a str)> {
        let mut rest = self.0;
        std::iter::from_fn(move || {
            loop {
                rest = rest.trim_start_matches([' ', '\t']);
                if rest.is_empty() {
                    return None;
                }
                let mut quote = None;
                let end = rest.find(|character: char| {
                    match quote {
                        Some(open) if open == character => quote = None,
                        None if matches!(character, '"' | '\'') => quote = Some(character),
                        None => return matches!(character, ' ' | '\t'),
                        Some(_) => {}
                    }
                    false
                });
                let (word, after) = rest.split_at(end.unwrap_or(rest.len()));
                rest = after;
                if let Some((key, value)) = word.split_once('=') {
                    return Some((key, value.trim_matches(['"', '\''])));
                }
            }
        })
    }

    /// The value of a key; of several the last counts, as in Klipper.
    pub fn value(self, key: &str) -> Option<&'a str> {
        self.pairs().filter(|(found, _)| found.eq_ignore_ascii_case(key)).last().map(|(_, value)| value)
    }

    /// The value of a key as a number.
    ///
    /// # Errors
    /// It is not a number.
    pub fn number(self, key: &str) -> Result<Option<Decimal>, String> {
        let Some(value) = self.value(key) else { return Ok(None) };
        let number = Decimal::parse(value.as_bytes()).map_err(|_| format!("{key}={value}: expected a number"))?;
        Ok(Some(number))
    }

    /// The value of a key that is 0 or 1, 0 without it.
    ///
    /// # Errors
    /// It is not a number.
    pub fn flag(self, key: &str) -> Result<bool, String> {
        Ok(self.number(key)?.is_some_and(|value| value != Decimal::ZERO))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn words_are_divided_at_blanks_outside_quotes() {
        let words = Words::of("NAME  a=1 b=\"two words\" bare C='x=y' a=-2.5 d=");
        let pairs: Vec<_> = words.pairs().collect();
        assert_eq!(pairs, [("a", "1"), ("b", "two words"), ("C", "x=y"), ("a", "-2.5"), ("d", "")]);
        assert_eq!(words.number("A").unwrap().map(Decimal::nanos), Some(-2_500_000_000));
        assert_eq!(words.number("B").unwrap_err(), "B=two words: expected a number");
        assert!(words.number("d").is_err() && words.number("e").unwrap().is_none() && words.flag("a").unwrap());
        assert_eq!(Words::of("NAME").pairs().count(), 0);
    }
}
