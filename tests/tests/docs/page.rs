//! A page of Markdown: its code spans, its links and its headings, each with its line.

/// A page and its path.
pub struct Page {
    /// Path from the repository's root.
    pub path: String,
    /// The text.
    pub text: String,
}

/// A name in a line of a page.
pub struct Place<'a> {
    /// Line of the page, from 1.
    pub line: usize,
    /// The text between backticks, or the target of a link.
    pub text: &'a str,
}

impl Page {
    /// Texts between single backticks, outside of code blocks.
    pub fn code_spans(&self) -> Vec<Place<'_>> {
        let mut found = Vec::new();
        for (line, text) in self.prose() {
            found.extend(text.split('`').skip(1).step_by(2).map(|text| Place { line, text }));
        }
        found
    }

    /// Words of indented and fenced code blocks, where commands name files.
    pub fn block_words(&self) -> Vec<Place<'_>> {
        let lines = self.lines().filter(|(_, text, is_code)| *is_code && !text.contains("{{#"));
        lines.flat_map(|(line, text, _)| text.split_whitespace().map(move |text| Place { line, text })).collect()
    }

    /// Targets of links and images, `[text](target)`.
    pub fn links(&self) -> Vec<Place<'_>> {
        let mut found = Vec::new();
        for (line, text) in self.prose() {
            for (start, _) in text.match_indices("](") {
                let target = &text[start + 2..];
                found.extend(target.find(')').map(|end| Place { line, text: &target[..end] }));
            }
        }
        found
    }

    /// Files that mdBook includes, `{{#include file:anchor}}`.
    pub fn includes(&self) -> Vec<Place<'_>> {
        let mut found = Vec::new();
        for (line, text, _) in self.lines() {
            if let Some(start) = text.find("{{#include ") {
                let target = &text[start + "{{#include ".len()..];
                found.extend(target.find("}}").map(|end| Place { line, text: &target[..end] }));
            }
        }
        found
    }

    /// The anchors that links may name: headings, as mdBook and GitHub spell them.
    pub fn anchors(&self) -> Vec<String> {
        let headings = self.prose().into_iter().filter(|(_, text)| text.starts_with('#'));
        headings.map(|(_, text)| anchor(text.trim_start_matches('#').trim())).collect()
    }

    fn prose(&self) -> Vec<(usize, &str)> {
        self.lines().filter(|(_, _, is_code)| !is_code).map(|(line, text, _)| (line, text)).collect()
    }

    /// Number, text, and whether the line belongs to a code block.
    fn lines(&self) -> impl Iterator<Item = (usize, &str, bool)> {
        let mut is_fenced = false;
        self.text.lines().enumerate().map(move |(index, text)| {
            let is_fence = text.trim_start().starts_with("```");
            is_fenced ^= is_fence;
            (index + 1, text, is_fenced || is_fence || text.starts_with("    "))
        })
    }
}

/// A heading as the end of an address: lower case, spaces as hyphens, punctuation dropped.
pub fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|&c| c.is_alphanumeric() || c == ' ' || c == '-' || c == '_');
    kept.map(|c| if c == ' ' { '-' } else { c }).collect::<String>().to_lowercase()
}
