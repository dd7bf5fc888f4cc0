//! The head of an imported profile, by which a later import sees whether a person has edited it.

const HEAD: &str = "# Made by `ferrostep import`. Every key, with its range and meaning: the book's page on profiles.";
const SUM: &str = "# Unchanged since then while this is the sum of the lines below: ";

/// A profile's text with the head.
pub(crate) fn marked(text: &str) -> String {
    format!("{HEAD}\n{SUM}{:016x}\n\n{text}", sum(text))
}

/// Returns true if an import has written a text and it has not changed since.
pub fn is_untouched(text: &str) -> bool {
    let Some((said, body)) = text
        .strip_prefix(HEAD)
        .and_then(|rest| rest.trim_start_matches(['\r', '\n']).strip_prefix(SUM))
        .and_then(|rest| rest.split_once("\n\n"))
    else {
        return false;
    };
    said == format!("{:016x}", sum(body))
}

/// FNV-1a: against edits, not against attacks.
fn sum(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edit_is_seen() {
        let text = marked("a = 1\n\n[b]\nc = 2\n");
        assert!(is_untouched(&text));
        assert!(!is_untouched(&text.replace("a = 1", "a = 2")));
        assert!(!is_untouched("a = 1\n"));
        assert!(!is_untouched(""));
    }
}
