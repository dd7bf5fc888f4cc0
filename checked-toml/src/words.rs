//! Keys and their alternatives in words, for refusals and for the book.

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

fn alternatives(mut words: Vec<String>) -> String {
    match words.pop() {
        None => "no key".to_owned(),
        Some(last) if words.is_empty() => last,
        Some(last) => format!("{} or {last}", words.join(", ")),
    }
}
