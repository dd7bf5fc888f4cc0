//! The generated parts of the book's pages: a task writes the text between two marks, a
//! person the rest.

use std::path::PathBuf;

use crate::steps::Failure;
use crate::system;

/// The end of every generated part.
const END: &str = "<!-- Here it ends. -->\n";

/// A page with a part that a command writes.
#[derive(Clone, Copy, Debug)]
pub struct Page {
    /// Path of the page, from the root.
    pub path: &'static str,
    /// The command that writes the part.
    pub command: &'static str,
}

impl Page {
    /// The page's text.
    pub fn read(self) -> Result<String, Failure> {
        let path = self.file();
        std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))
    }

    /// The generated part of the page's text.
    pub fn generated(self, text: &str) -> Result<&str, Failure> {
        self.parts(text).map(|[_, generated, _]| generated)
    }

    /// Returns the text with another generated part.
    pub fn replaced(self, text: &str, generated: &str) -> Result<String, Failure> {
        let [before, _, after] = self.parts(text)?;
        Ok(format!("{before}{}\n{generated}\n{END}{after}", self.begin()))
    }

    /// Writes the page with another generated part.
    pub fn write(self, generated: &str) -> Result<(), Failure> {
        let text = self.replaced(&self.read()?, generated)?;
        let path = self.file();
        std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))
    }

    fn file(self) -> PathBuf {
        system::root().join(self.path)
    }

    fn begin(self) -> String {
        format!("<!-- What follows is written by `{}`. -->\n", self.command)
    }

    /// The text before the marks, between them, and after them.
    fn parts(self, text: &str) -> Result<[&str; 3], Failure> {
        let parts = || {
            let (before, rest) = text.split_once(&self.begin())?;
            let (generated, after) = rest.split_once(END)?;
            Some([before, generated, after])
        };
        parts().ok_or_else(|| format!("{} has lost the marks around what `{}` writes", self.path, self.command))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const PAGE: Page = Page { path: "docs/page.md", command: "cargo xtask it" };

    #[test]
    fn only_text_between_the_marks_is_replaced() {
        let begin = "<!-- What follows is written by `cargo xtask it`. -->\n";
        let text = format!("by hand\n{begin}old\n{END}more by hand\n");
        assert_eq!(PAGE.generated(&text).unwrap(), "old\n");
        let expected = format!("by hand\n{begin}\nnew\n\n{END}more by hand\n");
        assert_eq!(PAGE.replaced(&text, "new\n").unwrap(), expected);
        let error = PAGE.replaced("no marks", "new").unwrap_err();
        assert_eq!(error, "docs/page.md has lost the marks around what `cargo xtask it` writes");
    }
}
