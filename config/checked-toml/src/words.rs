//! Keys and their alternatives in words, for refusals and for the book.

/// Minimum likeness of a suggestion, 0 to 1: one letter in four may differ.
const MIN_LIKENESS: f64 = 0.75;

/// A key within a table's path.
pub(crate) fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// `"a", "b" or "c"`.
pub(crate) fn one_of(words: impl IntoIterator<Item = impl AsRef<str>>) -> String {
    alternatives(words.into_iter().map(|word| format!("\"{}\"", word.as_ref())).collect())
}

/// The same as code.
pub(crate) fn one_of_in_book<T>(choices: &[(&'static str, T)]) -> String {
    alternatives(choices.iter().map(|(word, _)| format!("`\"{word}\"`")).collect())
}

/// The word that was probably meant: one that differs from the written one by its case,
/// or by little else.
pub fn closest<'a>(written: &str, words: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let written = written.to_ascii_lowercase();
    let alike = words
        .into_iter()
        .map(|word| (strsim::normalized_damerau_levenshtein(&written, &word.to_ascii_lowercase()), word));
    alike
        .filter(|(likeness, _)| *likeness >= MIN_LIKENESS)
        .max_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, word)| word)
}

fn alternatives(mut words: Vec<String>) -> String {
    match words.pop() {
        None => "no key".to_owned(),
        Some(last) if words.is_empty() => last,
        Some(last) => format!("{} or {last}", words.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closest_word_is_found() {
        let words = ["cartesian", "corexy", "prusa-mini"];
        for (written, meant) in [
            ("corxy", Some("corexy")),
            ("Prusa-MINI", Some("prusa-mini")),
            ("cartesain", Some("cartesian")),
            ("nope", None),
            ("", None),
        ] {
            assert_eq!(closest(written, words), meant, "{written}");
        }
        // Nearer goes before earlier.
        assert_eq!(closest("size_m", ["size_mn_x", "size_mm"]), Some("size_mm"));
    }
}
