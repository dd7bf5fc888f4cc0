//! The job's file: G-code or a prepared job, plain or gzip, read in portions. The content decides which it is, not the name.

use std::cell::Cell;
use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;
use std::rc::Rc;

use ferrostep_gpre::Header;
use flate2::bufread::MultiGzDecoder;

/// Bytes at the start of a file that are examined to tell text from binary data.
const LOOK_BYTES: usize = 64 * 1024;

/// Why a job could not be started from a file.
#[derive(Debug)]
pub enum InputError {
    /// It cannot be opened or read.
    Read(io::Error),
    /// The file is empty.
    Empty,
    /// The file holds a byte that G-code cannot contain.
    NotText {
        /// Offset of the first such byte, from 0.
        offset: usize,
        /// The byte.
        byte: u8,
    },
}

impl fmt::Display for InputError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(error) => write!(out, "cannot be read: {error}"),
            Self::Empty => write!(out, "the file is empty: expected G-code or a prepared job"),
            Self::NotText { offset, byte } => {
                write!(
                    out,
                    "not a text file: byte 0x{byte:02x} at offset {offset}, expected G-code or a prepared job (or gzip of it)"
                )
            }
        }
    }
}

impl std::error::Error for InputError {}

/// Counts the bytes that pass.
struct Counting<R> {
    inner: R,
    count: Rc<Cell<u64>>,
}

impl<R: Read> Read for Counting<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.count.set(self.count.get() + read as u64);
        Ok(read)
    }
}

/// An open job.
pub struct Input {
    reader: Box<dyn BufRead>,
    is_prepared: bool,
    read: Rc<Cell<u64>>,
    size: u64,
}

impl Input {
    /// Opens a file and decides from its first bytes what it is.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        let file = File::open(path).map_err(InputError::Read)?;
        let size = file.metadata().map_err(InputError::Read)?.len();
        let read = Rc::new(Cell::new(0));
        let mut plain = BufReader::with_capacity(LOOK_BYTES, Counting { inner: file, count: Rc::clone(&read) });
        let is_gzip = plain.fill_buf().map_err(InputError::Read)?.starts_with(&[0x1f, 0x8b]);
        let mut reader: Box<dyn BufRead> = if is_gzip {
            Box::new(BufReader::with_capacity(LOOK_BYTES, MultiGzDecoder::new(plain)))
        } else {
            Box::new(plain)
        };
        let start = reader.fill_buf().map_err(InputError::Read)?;
        if start.is_empty() {
            return Err(InputError::Empty);
        }
        if Header::is_gpre(start) {
            return Ok(Self { reader, is_prepared: true, read, size });
        }
        // Bytes from 0x80 on may be UTF-8 in a comment; the line reader looks closer where it matters.
        let control = |byte: &u8| *byte < 0x20 && !b"\t\n\x0b\x0c\r\x1b".contains(byte);
        if let Some(offset) = start.iter().position(control) {
            return Err(InputError::NotText { offset, byte: start[offset] });
        }
        if start.starts_with(b"\xef\xbb\xbf") {
            // The byte order mark that some editors on Windows write.
            reader.consume(3);
        }
        Ok(Self { reader, is_prepared: false, read, size })
    }

    /// Puts bytes back in front of those that remain, for the next reader.
    pub fn put_back(&mut self, bytes: Vec<u8>) {
        let rest = std::mem::replace(&mut self.reader, Box::new(io::empty()));
        self.reader = Box::new(Cursor::new(bytes).chain(rest));
    }

    /// Whether it is a prepared job (GPRE), not G-code.
    pub fn is_prepared(&self) -> bool {
        self.is_prepared
    }

    /// A counter of the bytes read from the disk so far (compressed bytes, for gzip).
    pub fn counter(&self) -> Rc<Cell<u64>> {
        Rc::clone(&self.read)
    }

    /// Size of the file on the disk, bytes.
    pub fn size_bytes(&self) -> u64 {
        self.size
    }
}

impl Read for Input {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.reader.read(buffer)
    }
}

impl BufRead for Input {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.reader.fill_buf()
    }

    fn consume(&mut self, bytes: usize) {
        self.reader.consume(bytes);
    }
}
