//! The text of a job as it is read: what slicers say in comments, and the lines
//! themselves for the page.

use std::cell::RefCell;
use std::io::{self, Read};
use std::rc::Rc;

use crate::comment_reader::CommentReader;
use crate::marks::{Mark, Marks};
use crate::totals::MAX_FEATURES;

/// Maximum number of comments that wait for a command after them: a file of nothing but comments
/// must not fill the memory.
const MAX_WAITING: usize = 1 << 20;
/// Longest line that is kept for the page whole.
const LINE_BYTES: usize = 200;

/// Text that has been read.
#[derive(Debug, Default)]
pub struct Text {
    /// The first lines, each ended by a line feed.
    pub kept: Vec<u8>,
    /// True if later lines were not kept.
    pub is_cut: bool,
    /// Names of features, in the order of their first lines; the first is empty, for lines
    /// without a feature.
    pub features: Vec<String>,
    /// True if the file marks its layers.
    pub has_layers: bool,
    /// Comments that have been read and whose lines have not been reached: (line, what
    /// holds from then on).
    changes: std::collections::VecDeque<(u32, Change)>,
    marks: Marks,
    layer: u32,
    marked: Marked,
}

/// Layer, feature and bead of a line by the comments before it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Marked {
    /// Layer, from 0; `None` where the file marks none.
    pub layer: Option<u32>,
    /// Number of the feature in the list of their names.
    pub feature: u8,
    /// Height of beads, mm; 0 if unknown.
    pub height_mm: f32,
    /// Width of beads, mm; 0 if unknown.
    pub width_mm: f32,
}

#[derive(Clone, Copy, Debug)]
enum Change {
    Layer,
    Feature(u8),
    Height(f32),
    Width(f32),
}

impl Text {
    /// Returns what comments say of a line; lines must not go back.
    pub fn at(&mut self, line: u32) -> Marked {
        while let Some((_, change)) = self.changes.pop_front_if(|(from, _)| *from <= line) {
            match change {
                // The first mark begins layer 0.
                Change::Layer if !self.has_layers => self.has_layers = true,
                Change::Layer => self.layer += 1,
                // A width is of one feature.
                Change::Feature(feature) => (self.marked.feature, self.marked.width_mm) = (feature, 0.0),
                Change::Height(height_mm) => self.marked.height_mm = height_mm,
                Change::Width(width_mm) => self.marked.width_mm = width_mm,
            }
        }
        Marked { layer: self.has_layers.then_some(self.layer), ..self.marked }
    }

    fn note(&mut self, line: u32, comment: &str) {
        if self.changes.len() == MAX_WAITING {
            self.changes.pop_front();
        }
        match self.marks.read(comment) {
            Some(Mark::Layer) => self.changes.push_back((line, Change::Layer)),
            Some(Mark::Feature(name)) => {
                let known = self.features.iter().position(|known| *known == name);
                let number = known.or_else(|| {
                    (self.features.len() < MAX_FEATURES).then(|| {
                        self.features.push(name);
                        self.features.len() - 1
                    })
                });
                self.changes.push_back((line, Change::Feature(number.unwrap_or(0) as u8)));
            }
            Some(Mark::Height(height_mm)) => self.changes.push_back((line, Change::Height(height_mm))),
            Some(Mark::Width(width_mm)) => self.changes.push_back((line, Change::Width(width_mm))),
            Some(Mark::Time(_)) | None => {}
        }
    }
}

/// Reads a job's text and passes it on.
pub struct SourceText<R> {
    inner: R,
    text: Rc<RefCell<Text>>,
    max_bytes: usize,
    comments: CommentReader,
    line_bytes: usize,
    after_return: bool,
}

impl<R: Read> SourceText<R> {
    /// Keeps at most `max_bytes` of the text.
    pub fn new(inner: R, max_bytes: usize) -> Self {
        let text = Text { features: vec![String::new()], ..Text::default() };
        Self {
            inner,
            text: Rc::new(RefCell::new(text)),
            max_bytes,
            comments: CommentReader::default(),
            line_bytes: 0,
            after_return: false,
        }
    }

    /// Returns the text that has been read.
    pub fn text(&self) -> Rc<RefCell<Text>> {
        Rc::clone(&self.text)
    }

    fn scan(&mut self, bytes: &[u8]) {
        let mut text = self.text.borrow_mut();
        self.comments.read(bytes, |line, comment| text.note(line, comment));
        for &byte in bytes {
            let follows_return = std::mem::take(&mut self.after_return);
            if byte == b'\n' && follows_return {
                continue;
            }
            if byte == b'\n' || byte == b'\r' {
                text.is_cut |= text.kept.len() >= self.max_bytes;
                if !text.is_cut {
                    text.kept.push(b'\n');
                }
                self.line_bytes = 0;
                self.after_return = byte == b'\r';
                continue;
            }
            if self.line_bytes == 0 {
                // Only whole lines are kept.
                text.is_cut |= text.kept.len() + LINE_BYTES + 1 > self.max_bytes;
            }
            if !text.is_cut && self.line_bytes < LINE_BYTES {
                text.kept.push(byte);
            }
            self.line_bytes += 1;
        }
    }
}

impl<R: Read> Read for SourceText<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.scan(buffer.get(..read).unwrap_or_default());
        Ok(read)
    }
}
