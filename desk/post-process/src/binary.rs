//! Copies a file of binary G-code with the times of its print.
//!
//! Blocks of metadata with a time, and those of G-code, are written anew in the form that they had;
//! all others are copied byte for byte. The G-code's blocks are cut anew, as its text may grow.

use std::io::{self, BufReader, Read, Seek, Write};

use ferrostep_binary_gcode::{BlockKind, FileForm, Form, Reason};

use crate::print_times::PrintTimes;
use crate::rewrite::{Additions, Changes, RewriteError, rewrite, with_times};

/// Maximum number of bytes of the text in a block, as in the files of slicers.
const BLOCK_BYTES: usize = 1 << 16;

/// Copies a file with the times of its print, and with what is added to it. `text`: its G-code.
///
/// # Errors
/// Reading or writing fails, or M73 would come between numbered lines.
pub fn rewrite_binary(
    file: impl Read + Seek,
    text: impl Read,
    out: &mut impl Write,
    times: &PrintTimes,
    additions: Additions<'_>,
) -> Result<Changes, RewriteError> {
    let mut file = BufReader::new(file);
    let mut header = [0; FileForm::BYTES];
    file.read_exact(&mut header).map_err(RewriteError::Read)?;
    let file_form = FileForm::of(&header).map_err(damaged)?;
    out.write_all(&header).map_err(RewriteError::Write)?;
    let (mut changes, mut text) = (Changes::default(), Some(text));
    while let Some(form) = next_form(&mut file, file_form)? {
        match form.kind() {
            BlockKind::Gcode => {
                // The first block: all G-code is written here.
                if let Some(text) = text.take() {
                    let mut blocks = GcodeBlocks { out: &mut *out, form, text: Vec::new() };
                    changes = changes.and(rewrite(text, &mut blocks, times, additions)?);
                    blocks.end().map_err(RewriteError::Write)?;
                }
                skip(&mut file, form.block_bytes())?;
            }
            BlockKind::PrinterMetadata | BlockKind::PrintMetadata => {
                let mut block = Vec::new();
                (&mut file).take(form.block_bytes()).read_to_end(&mut block).map_err(RewriteError::Read)?;
                let (entries, metadata) = corrected(&form.contents(&block).map_err(damaged)?, times);
                let block = if metadata.differs { form.block(&entries) } else { block };
                changes = changes.and(metadata);
                out.write_all(&block).map_err(RewriteError::Write)?;
            }
            BlockKind::FileMetadata | BlockKind::SlicerMetadata | BlockKind::Thumbnail { .. } => {
                copy(&mut file, out, form.block_bytes())?;
            }
        }
    }
    Ok(changes)
}

/// The form of the block that comes next; `None` at the end of the file.
fn next_form(file: &mut BufReader<impl Read + Seek>, file_form: FileForm) -> Result<Option<Form>, RewriteError> {
    let mut start = Vec::new();
    file.take(Form::MAX_HEAD_BYTES as u64).read_to_end(&mut start).map_err(RewriteError::Read)?;
    file.seek_relative(-(start.len() as i64)).map_err(RewriteError::Read)?;
    if start.is_empty() {
        return Ok(None);
    }
    Form::of(file_form, &start).map(Some).map_err(damaged)
}

fn skip(file: &mut BufReader<impl Read + Seek>, bytes: u64) -> Result<(), RewriteError> {
    i64::try_from(bytes)
        .map_err(io::Error::other)
        .and_then(|bytes| file.seek_relative(bytes))
        .map_err(RewriteError::Read)
}

/// Copies this many bytes from the file.
fn copy(file: &mut impl Read, out: &mut impl Write, mut left: u64) -> Result<(), RewriteError> {
    let mut portion = vec![0; BLOCK_BYTES];
    while left > 0 {
        let length = BLOCK_BYTES.min(usize::try_from(left).unwrap_or(BLOCK_BYTES));
        let portion = portion.get_mut(..length).unwrap_or_default();
        file.read_exact(portion).map_err(RewriteError::Read)?;
        out.write_all(portion).map_err(RewriteError::Write)?;
        left -= length as u64;
    }
    Ok(())
}

/// Entries of metadata with the times of the print.
fn corrected(entries: &[u8], times: &PrintTimes) -> (Vec<u8>, Changes) {
    let (mut text, mut changes) = (Vec::with_capacity(entries.len()), Changes::default());
    for line in entries.split_inclusive(|byte| *byte == b'\n') {
        let entry = line.strip_suffix(b"\n").unwrap_or(line);
        let new = with_times(entry, times, 1);
        changes.comments += u64::from(new.is_some());
        text.extend_from_slice(new.as_deref().unwrap_or(entry));
        text.extend_from_slice(line.get(entry.len()..).unwrap_or_default());
    }
    changes.differs = text != entries;
    (text, changes)
}

fn damaged(reason: Reason) -> RewriteError {
    RewriteError::Read(io::Error::new(io::ErrorKind::InvalidData, reason.to_string()))
}

/// Writer of text as blocks of G-code: each as long as allowed, and of whole lines.
struct GcodeBlocks<W> {
    out: W,
    form: Form,
    text: Vec<u8>,
}

impl<W: Write> GcodeBlocks<W> {
    /// Writes the text's first bytes as a block.
    fn write_block(&mut self, length: usize) -> io::Result<()> {
        let rest = self.text.split_off(length.min(self.text.len()));
        let text = std::mem::replace(&mut self.text, rest);
        self.out.write_all(&self.form.block(&text))
    }

    /// Writes the last block.
    fn end(mut self) -> io::Result<()> {
        if self.text.is_empty() { Ok(()) } else { self.write_block(self.text.len()) }
    }
}

impl<W: Write> Write for GcodeBlocks<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.text.extend_from_slice(bytes);
        while self.text.len() > BLOCK_BYTES {
            let lines = self.text.get(..BLOCK_BYTES).and_then(|text| text.iter().rposition(|byte| *byte == b'\n'));
            self.write_block(lines.map_or(BLOCK_BYTES, |end| end + 1))?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
