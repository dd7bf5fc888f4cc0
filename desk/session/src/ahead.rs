//! A file that is read in portions, and of which the next bytes can be seen before their turn.

use std::io::{self, ErrorKind, Read};

/// Bytes read at once, all of which may be executed between two looks at the progress.
pub(crate) const PORTION_BYTES: usize = 4 * 1024;

/// Maximum number of bytes seen ahead.
const MAX_AHEAD_BYTES: usize = 1 << 20;

/// A reader with a bounded view of the bytes ahead.
pub(crate) struct Ahead<'a> {
    input: &'a mut dyn Read,
    /// Bytes that have been read before their turn.
    waiting: Vec<u8>,
    /// Error of a reading before its turn.
    error: Option<io::Error>,
    has_ended: bool,
}

impl<'a> Ahead<'a> {
    /// A file from its beginning.
    pub fn new(input: &'a mut dyn Read) -> Self {
        Self { input, waiting: Vec::new(), error: None, has_ended: false }
    }

    /// Replaces `portion` by the next bytes; it is empty after the last.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn next(&mut self, portion: &mut Vec<u8>) -> io::Result<()> {
        portion.clear();
        if self.waiting.is_empty() {
            if let Some(error) = self.error.take() {
                return Err(error);
            }
            return self.read(portion);
        }
        let rest = self.waiting.split_off(PORTION_BYTES.min(self.waiting.len()));
        *portion = std::mem::replace(&mut self.waiting, rest);
        Ok(())
    }

    /// The bytes after the present portion, up to [`MAX_AHEAD_BYTES`] or the file's end.
    pub fn see(&mut self) -> &[u8] {
        let mut portion = Vec::new();
        while self.waiting.len() < MAX_AHEAD_BYTES && self.error.is_none() && !self.has_ended {
            match self.read(&mut portion) {
                Ok(()) => self.waiting.extend(&portion),
                Err(error) => self.error = Some(error),
            }
        }
        &self.waiting
    }

    /// The bytes that have been read before their turn.
    pub fn waiting(&self) -> &[u8] {
        &self.waiting
    }

    fn read(&mut self, portion: &mut Vec<u8>) -> io::Result<()> {
        portion.resize(PORTION_BYTES, 0);
        loop {
            match self.input.read(portion) {
                Ok(length) => {
                    self.has_ended = length == 0;
                    portion.truncate(length);
                    return Ok(());
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => {
                    portion.clear();
                    return Err(error);
                }
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Some bytes, and then an error.
    struct Torn(usize);

    impl Read for Torn {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            if self.0 == 0 {
                return Err(io::Error::other("torn"));
            }
            let length = self.0.min(buffer.len()).min(1000);
            self.0 -= length;
            buffer[..length].fill(b'x');
            Ok(length)
        }
    }

    #[test]
    fn what_was_seen_comes_in_its_turn() {
        let text: Vec<u8> = (0..3 * MAX_AHEAD_BYTES).map(|number| number as u8).collect();
        for looks_at in [0, 1, 5] {
            let mut input = &text[..];
            let (mut ahead, mut portion, mut read) = (Ahead::new(&mut input), Vec::new(), Vec::<u8>::new());
            for number in 0.. {
                ahead.next(&mut portion).unwrap();
                if portion.is_empty() {
                    break;
                }
                assert!(portion.len() <= PORTION_BYTES);
                read.extend(&portion);
                if number == looks_at {
                    let seen = ahead.see();
                    assert!((MAX_AHEAD_BYTES..MAX_AHEAD_BYTES + PORTION_BYTES).contains(&seen.len()));
                    assert_eq!(seen, &text[read.len()..][..seen.len()]);
                }
            }
            assert!(read == text, "{looks_at}");
        }
    }

    #[test]
    fn an_error_comes_in_its_turn() {
        let mut input = Torn(10_000);
        let (mut ahead, mut portion) = (Ahead::new(&mut input), Vec::new());
        assert_eq!(ahead.see().len(), 10_000);
        let mut read = 0;
        let error = loop {
            match ahead.next(&mut portion) {
                Ok(()) => read += portion.len(),
                Err(error) => break error,
            }
        };
        assert_eq!((read, error.to_string()), (10_000, "torn".to_owned()));
    }
}
