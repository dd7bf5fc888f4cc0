//! The page: text, style and script in one file, which loads nothing and connects only to its own
//! server.

use std::sync::LazyLock;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};

use crate::answer::Answer;

const TEXT: &str = include_str!("../page/page.html");
const STYLE: &str = include_str!("../page/page.css");
const SCRIPT: &str = include_str!("../page/page.js");

static PAGE: LazyLock<String> = LazyLock::new(|| TEXT.replace("{{style}}", STYLE).replace("{{script}}", SCRIPT));

static POLICY: LazyLock<String> = LazyLock::new(|| {
    let hash = |part: &str| STANDARD.encode(Sha256::digest(part));
    format!(
        "default-src 'none'; script-src 'sha256-{}'; style-src 'sha256-{}'; connect-src 'self'; img-src data:; base-uri 'none'; \
         form-action 'none'; frame-ancestors 'none'",
        hash(SCRIPT),
        hash(STYLE)
    )
});

/// Returns the page.
pub fn page() -> Answer {
    Answer::page(&PAGE, &POLICY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_loads_nothing_and_its_parts_are_those_of_its_policy() {
        assert!(!PAGE.contains("{{") && !PAGE.contains("src=") && !PAGE.contains("http:") && !PAGE.contains("https:"));
        for (part, tag) in [(STYLE, "style"), (SCRIPT, "script")] {
            assert!(PAGE.contains(&format!("<{tag}>{part}</{tag}>")), "the hash is that of the element's whole text");
            assert!(!part.contains("</"), "{tag}");
        }
    }
}
