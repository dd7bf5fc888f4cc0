//! Copies a file and puts the times of its print in place of the slicer's.

use std::fmt;
use std::io::{self, BufReader, Read, Write};

use ferrostep_show::{SlicerTime, slicer_times};

use crate::lines::{End, read_line};
use crate::moment::Moment;
use crate::print_times::PrintTimes;
use crate::progress_line::{is_numbered, with_moment, words};

/// Bytes read at once.
const PORTION_BYTES: usize = 1 << 16;

/// The byte order mark that some editors on Windows write.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Reason for which a file could not be copied.
#[derive(Debug)]
pub enum RewriteError {
    /// The file cannot be read.
    Read(io::Error),
    /// The copy cannot be written.
    Write(io::Error),
    /// The lines are numbered from this one on, and one without a number would be refused.
    Numbered(u32),
}

impl fmt::Display for RewriteError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(error) => write!(out, "cannot be read: {error}"),
            Self::Write(error) => write!(out, "cannot be written: {error}"),
            Self::Numbered(line) => write!(
                out,
                "line {line}: the lines are numbered, and a printer refuses M73 without a number between them: add none \
                 (--no-m73), or give the file as the slicer wrote it"
            ),
        }
    }
}

impl std::error::Error for RewriteError {}

/// Number of the changes to a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// Comments that hold a time.
    pub comments: u64,
    /// Lines of the slicer with M73.
    pub progress_lines: u64,
    /// Lines with M73 that were added.
    pub added_lines: u64,
    /// Words for the time to a pause (M73 C, D) that stay as they are, since no pause comes after
    /// them.
    pub kept_pause_words: u64,
    /// True if the copy differs from the file.
    pub differs: bool,
}

impl Changes {
    /// These and the changes to another part of the file.
    pub(crate) const fn and(self, other: Self) -> Self {
        Self {
            comments: self.comments + other.comments,
            progress_lines: self.progress_lines + other.progress_lines,
            added_lines: self.added_lines + other.added_lines,
            kept_pause_words: self.kept_pause_words + other.kept_pause_words,
            differs: self.differs || other.differs,
        }
    }
}

/// Lines that a file gets if it has none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Additions<'a> {
    /// True to add M73 for each minute of a print that has none.
    pub progress: bool,
    /// A comment for the end, without its `;`.
    pub mark: Option<&'a str>,
}

/// Copies a file with the times of its print, and with what is added to it.
///
/// # Errors
/// Reading or writing fails, or M73 would come between numbered lines.
pub fn rewrite(
    input: impl Read,
    out: &mut impl Write,
    times: &PrintTimes,
    additions: Additions<'_>,
) -> Result<Changes, RewriteError> {
    let mut input = BufReader::with_capacity(PORTION_BYTES, input);
    let added = (additions.progress && !times.has_progress()).then(Added::default);
    let mark = additions.mark.map(|text| format!("; {text}"));
    let mut copy = Copy { out, times, added, mark, changes: Changes::default() };
    let (mut line, mut number, mut begins) = (Vec::new(), 1_u32, true);
    let mut newline: &[u8] = b"\n";
    loop {
        let end = read_line(&mut input, &mut line).map_err(RewriteError::Read)?;
        if let End::Line(bytes) = end {
            newline = bytes;
        }
        let is_over = line.is_empty() && end == End::File;
        if begins && !is_over {
            copy.line(number, &line, newline)?;
        } else {
            copy.write(&line)?;
        }
        match end {
            End::Line(bytes) => {
                copy.write(bytes)?;
                number = number.saturating_add(1);
                begins = true;
            }
            End::Unfinished => begins = false,
            End::File => {
                let has_open_line = !(begins && line.is_empty());
                copy.end(number.saturating_add(u32::from(has_open_line)), has_open_line, newline)?;
                return Ok(copy.changes);
            }
        }
    }
}

/// The lines with M73 that are added.
#[derive(Debug, Default)]
struct Added {
    /// The minutes left of the last one.
    minutes_left: Option<String>,
    /// True after the one for the end.
    is_complete: bool,
}

impl Added {
    /// The line that is due at a moment: one when the minutes left change, and one at the end.
    fn due(&mut self, moment: &Moment) -> Option<String> {
        let minutes_left = moment.word(b'R', 0)?;
        let is_end = moment.elapsed_s >= moment.total_s;
        if self.minutes_left.as_ref() == Some(&minutes_left) && is_end == self.is_complete {
            return None;
        }
        let text = format!("M73 P{} R{minutes_left}", moment.word(b'P', 0)?);
        (self.minutes_left, self.is_complete) = (Some(minutes_left), is_end);
        Some(text)
    }
}

/// A copy that is being written.
struct Copy<'a, W> {
    out: &'a mut W,
    times: &'a PrintTimes,
    added: Option<Added>,
    /// The comment for the end, until the file has it.
    mark: Option<String>,
    changes: Changes,
}

impl<W: Write> Copy<'_, W> {
    /// Writes a line, or the beginning of a long one, with the times that it tells; before it M73,
    /// where it is due.
    fn line(&mut self, number: u32, line: &[u8], newline: &[u8]) -> Result<(), RewriteError> {
        let mark = if number == 1 && line.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
        let (mark, line) = line.split_at_checked(mark).unwrap_or((&[], line));
        self.write(mark)?;
        if let Some(text) = self.due(number) {
            if is_numbered(line) {
                return Err(RewriteError::Numbered(number));
            }
            self.write(text.as_bytes())?;
            self.write(newline)?;
        }
        if self.mark.as_ref().is_some_and(|mark| mark.as_bytes() == line) {
            self.mark = None;
        }
        let changed = self.with_progress(number, line).or_else(|| self.with_times(number, line));
        self.changes.differs |= changed.as_ref().is_some_and(|text| text != line);
        self.write(changed.as_deref().unwrap_or(line))
    }

    /// Ends the file with M73, if it is due, and with the mark. `has_open_line`: the last line has
    /// no end, and shall have none afterwards.
    fn end(&mut self, number: u32, has_open_line: bool, newline: &[u8]) -> Result<(), RewriteError> {
        let (progress, mark) = (self.due(number), self.mark.take());
        self.changes.differs |= mark.is_some();
        let (before, after) = if has_open_line { (newline, &[][..]) } else { (&[][..], newline) };
        for text in progress.into_iter().chain(mark) {
            self.write(&[before, text.as_bytes(), after].concat())?;
        }
        Ok(())
    }

    /// The line with M73 that is due before a line.
    fn due(&mut self, number: u32) -> Option<String> {
        let is_begun = self.times.first_command().is_some_and(|first| number >= first);
        let added = self.added.as_mut().filter(|_| is_begun)?;
        let text = added.due(&self.times.moment(number))?;
        self.changes.added_lines += 1;
        self.changes.differs = true;
        Some(text)
    }

    /// A line with M73, with the moment in its words.
    fn with_progress(&mut self, number: u32, line: &[u8]) -> Option<Vec<u8>> {
        let words = words(line)?;
        let moment = self.times.moment(number);
        let is_for_pause = |letter: u8| matches!(letter, b'C' | b'c' | b'D' | b'd');
        if moment.to_pause_s.is_none() {
            self.changes.kept_pause_words += words.iter().filter(|word| is_for_pause(word.letter)).count() as u64;
        }
        self.changes.progress_lines += 1;
        Some(with_moment(line, &words, &moment))
    }

    /// A comment that holds a time, with the time of the print.
    fn with_times(&mut self, number: u32, line: &[u8]) -> Option<Vec<u8>> {
        let is_comment = line.trim_ascii_start().starts_with(b";");
        let text = is_comment.then(|| with_times(line, self.times, number)).flatten()?;
        self.changes.comments += 1;
        Some(text)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), RewriteError> {
        self.out.write_all(bytes).map_err(RewriteError::Write)
    }
}

/// A comment or an entry of metadata that holds a time, with the print's time at a line; `None` for
/// others.
pub(crate) fn with_times(line: &[u8], times: &PrintTimes, number: u32) -> Option<Vec<u8>> {
    // Comments may hold bytes of any encoding; those with a time are text.
    let found: Vec<SlicerTime> = slicer_times(std::str::from_utf8(line).ok()?).collect();
    let mut text = line.to_vec();
    for time in found.iter().rev() {
        text.splice(time.place.clone(), time.written(times.of_part(time.of, number)).into_bytes());
    }
    (!found.is_empty()).then_some(text)
}
