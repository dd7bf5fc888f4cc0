//! The lines that a job has left unread when it stops.

use std::io::{self, Read};

use ferrostep_gcode::{Checksum, LineReader};

use crate::ahead::PORTION_BYTES;

/// The lines after the one that stopped a job.
pub struct Unread {
    reader: LineReader,
    /// Bytes that the job has read, and whose lines it has not executed.
    bytes: Vec<u8>,
}

impl Unread {
    /// The bytes after those that a reader of lines has taken.
    pub(crate) const fn new(reader: LineReader, bytes: Vec<u8>) -> Self {
        Self { reader, bytes }
    }

    /// Reads these lines and those that follow in the file, up to its end or to where it cannot be
    /// read. `each` takes the number and the text of a line; damaged lines are left out.
    pub fn read(mut self, input: &mut impl Read, mut each: impl FnMut(u32, &str)) {
        let mut portion = std::mem::take(&mut self.bytes);
        loop {
            let mut rest = &portion[..];
            while !rest.is_empty() {
                let (used, line) = self.reader.feed(rest);
                rest = rest.get(used..).unwrap_or_default();
                if let Some(Ok(line)) = line
                    && matches!(line.checksum, Checksum::Absent | Checksum::Right)
                {
                    each(line.line_number, line.text);
                }
            }
            portion.resize(PORTION_BYTES, 0);
            match input.read(&mut portion) {
                Ok(0) => break,
                Ok(length) => portion.truncate(length),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => portion.clear(),
                Err(_) => break,
            }
        }
        if let Some(Ok(line)) = self.reader.finish() {
            each(line.line_number, line.text);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// The lines after the first two, of which the first portion ends at each byte.
    #[test]
    fn the_lines_are_read_wherever_a_portion_ends() {
        let text = b"G28\r\nG29\r\n\nG1 X1 ; there\rG1 \xff\nN5 G1 X9*1\nG1 X2";
        for end in 10..text.len() {
            let mut reader = LineReader::new();
            // The job has taken the return of the second line, but not its line feed.
            let (used, _) = reader.feed(&text[..5]);
            let taken = used + reader.feed(&text[used..9]).0;
            let unread = Unread::new(reader, text[taken..end].to_vec());
            let mut lines = Vec::new();
            unread.read(&mut &text[end..], |number, line| lines.push((number, line.to_owned())));
            assert_eq!(lines, [(4, "G1 X1".to_owned()), (7, "G1 X2".to_owned())], "{end}");
        }
    }
}
