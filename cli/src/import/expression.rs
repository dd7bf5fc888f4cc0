//! Values of Marlin's definitions: numbers, names of other definitions, sums and products, lists in braces.

use std::cell::Cell;
use std::collections::HashMap;

/// Most numbers, names and brackets of one value, those of the named values included; a definition may name itself.
const MAX_PARTS: usize = 100;

/// Types that a value may be made of: `double(20)`.
const CASTS: [&str; 4] = ["double", "float", "int", "long"];

/// Evaluates a number.
pub fn number(text: &str, names: &HashMap<String, String>) -> Option<f64> {
    let parts = Cell::new(0);
    let mut reader = Reader { rest: text.trim(), names, parts: &parts };
    let number = reader.sum()?;
    (reader.rest.trim().is_empty() && number.is_finite()).then_some(number)
}

/// Evaluates a list in braces; each part that is no number is `None`.
pub fn list(text: &str, names: &HashMap<String, String>) -> Option<Vec<Option<f64>>> {
    let inner = text.trim().strip_prefix('{')?.strip_suffix('}')?;
    Some(inner.split(',').map(|part| number(part, names)).collect())
}

struct Reader<'a> {
    rest: &'a str,
    names: &'a HashMap<String, String>,
    parts: &'a Cell<usize>,
}

impl Reader<'_> {
    /// Takes a character if it is next.
    fn take(&mut self, char: char) -> bool {
        self.rest = self.rest.trim_start();
        match self.rest.strip_prefix(char) {
            Some(rest) => {
                self.rest = rest;
                true
            }
            None => false,
        }
    }

    fn sum(&mut self) -> Option<f64> {
        let mut sum = self.product()?;
        loop {
            if self.take('+') {
                sum += self.product()?;
            } else if self.take('-') {
                sum -= self.product()?;
            } else {
                return Some(sum);
            }
        }
    }

    fn product(&mut self) -> Option<f64> {
        let mut product = self.factor()?;
        loop {
            if self.take('*') {
                product *= self.factor()?;
            } else if self.take('/') {
                product /= self.factor()?;
            } else {
                return Some(product);
            }
        }
    }

    fn factor(&mut self) -> Option<f64> {
        self.parts.set(self.parts.get() + 1);
        if self.parts.get() > MAX_PARTS {
            return None;
        }
        let number = if self.take('-') {
            -self.factor()?
        } else if self.take('(') {
            let number = self.sum()?;
            self.take(')').then_some(number)?
        } else {
            self.word()?
        };
        Some(number)
    }

    fn word(&mut self) -> Option<f64> {
        let is_part = |char: char| char.is_ascii_alphanumeric() || char == '_' || char == '.';
        let word_end = |from: usize| {
            let rest = self.rest.get(from..).unwrap_or_default();
            from + rest.find(|char| !is_part(char)).unwrap_or(rest.len())
        };
        let mut end = word_end(0);
        let (word, rest) = self.rest.split_at(end);
        // The sign of an exponent: 5.6e-3.
        if word.starts_with(|char: char| char.is_ascii_digit() || char == '.')
            && word.ends_with(['e', 'E'])
            && rest.starts_with(['-', '+'])
        {
            end = word_end(end + 1);
        }
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest;
        if word.starts_with(|char: char| char.is_ascii_digit() || char == '.') {
            return word.trim_end_matches(['f', 'F', 'L', 'U']).parse().ok();
        }
        if CASTS.contains(&word) && self.take('(') {
            let number = self.sum()?;
            return self.take(')').then_some(number);
        }
        let text = self.names.get(word)?;
        let mut inner = Reader { rest: text.trim(), names: self.names, parts: self.parts };
        let number = inner.sum()?;
        inner.rest.trim().is_empty().then_some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_worked_out() {
        let names = HashMap::from([("TEETH", "20"), ("STEPS", "((200) * (16) / double(2) / double(TEETH))")]);
        let names = names.into_iter().map(|(name, value)| (name.to_owned(), value.to_owned())).collect();
        assert_eq!(number("STEPS", &names), Some(80.0));
        assert_eq!(list("{ 5.6e-3f, 2E+1-3, 1e, 5e-TEETH }", &names), Some(vec![Some(0.0056), Some(17.0), None, None]));
        assert_eq!(
            list("{ STEPS, 760*1.5, unknown(3), double(1 }", &names),
            Some(vec![Some(80.0), Some(1140.0), None, None])
        );
    }
}
