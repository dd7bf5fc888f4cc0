//! Keeps the newest lines of the conversation with the printer.

use std::collections::VecDeque;

use serde::Serialize;

/// Maximum number of lines kept.
const MAX_LINES: usize = 500;

/// Maximum number of characters kept per line.
const MAX_CHARACTERS: usize = 300;

/// Speaker of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Speaker {
    /// A person at a page.
    Person,
    /// The printer.
    Printer,
    /// This program itself.
    Host,
}

/// A line of the console.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ConsoleLine {
    /// Number of the line, counted from 1.
    pub number: u64,
    /// Speaker of the line.
    pub speaker: Speaker,
    /// Text of the line, without control characters.
    pub text: String,
}

/// Newest lines of a conversation.
#[derive(Debug, Default)]
pub struct Console {
    lines: VecDeque<ConsoleLine>,
    last: u64,
}

impl Console {
    /// Adds a line; the oldest line is dropped when there are too many.
    pub fn add(&mut self, speaker: Speaker, text: &str) {
        self.last = self.last.saturating_add(1);
        let text = text.chars().filter(|char| !char.is_control()).take(MAX_CHARACTERS).collect();
        if self.lines.len() == MAX_LINES {
            self.lines.pop_front();
        }
        self.lines.push_back(ConsoleLine { number: self.last, speaker, text });
    }

    /// Returns the kept lines after this number, oldest first.
    #[must_use]
    pub fn after(&self, number: u64) -> Vec<ConsoleLine> {
        self.lines.iter().filter(|line| line.number > number).cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_lines_are_kept_and_numbered() {
        let mut console = Console::default();
        for number in 0..MAX_LINES + 10 {
            console.add(Speaker::Printer, &format!("line {number}\u{1b}[31m"));
        }
        let all = console.after(0);
        assert_eq!((all.len(), all[0].number, all[0].text.as_str()), (MAX_LINES, 11, "line 10[31m"));
        assert_eq!(console.after(MAX_LINES as u64 + 9).len(), 1);
        assert!(console.after(u64::MAX).is_empty());
    }
}
