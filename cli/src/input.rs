//! The job's file: G-code as text or binary, or a prepared job, plain or gzip, read in portions; or the same from standard input.
//! The content decides the kind, not the name.

mod binary;
mod foreign;

use std::cell::Cell;
use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use ferrostep_binary_gcode::{Error as BinaryError, MAGIC};
use ferrostep_gpre::Header;
use flate2::bufread::MultiGzDecoder;

pub use binary::{Description, SlicerFigures};
pub use foreign::Foreign;

/// Bytes at the start of a file that are examined to tell text from binary data.
const LOOK_BYTES: usize = 64 * 1024;

/// Bytes to wait for on a pipe that brings them piece by piece, or the end of a line: a person who types G-code into a pipe gets
/// an answer to each line.
const AWAITED_BYTES: usize = 512;

/// The name that stands for standard input.
const STANDARD_INPUT: &str = "-";

/// Why a job could not be started from a file.
#[derive(Debug)]
pub enum InputError {
    /// It cannot be opened or read.
    Read(io::Error),
    /// The file is empty.
    Empty,
    /// The file is not a job but of another known kind.
    Foreign(Foreign),
    /// The file holds a byte that G-code cannot contain.
    NotText {
        /// Offset of the first such byte, from 0.
        offset: usize,
        /// The byte.
        byte: u8,
    },
    /// Binary G-code that is damaged, or of an unknown kind.
    Binary(BinaryError),
}

impl fmt::Display for InputError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(error) => write!(out, "cannot be read: {error}"),
            Self::Empty => write!(out, "the file is empty: expected G-code or a prepared job"),
            Self::Foreign(foreign) => foreign.fmt(out),
            Self::NotText { offset, byte } => {
                write!(
                    out,
                    "not a text file: byte 0x{byte:02x} at offset {offset}, expected G-code or a prepared job (or gzip of it)"
                )
            }
            Self::Binary(error) => error.fmt(out),
        }
    }
}

impl std::error::Error for InputError {}

impl From<io::Error> for InputError {
    fn from(error: io::Error) -> Self {
        Self::Read(error)
    }
}

/// Whether a path stands for standard input.
pub fn is_standard_input(path: &Path) -> bool {
    path.as_os_str() == STANDARD_INPUT
}

/// A job's file on one line, as messages name it.
pub fn name(path: &Path) -> String {
    if is_standard_input(path) { "standard input".to_owned() } else { crate::terminal::name(path) }
}

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

/// All bytes of a file, or of standard input if the path is `-`, as they are: for [`Input::of_bytes`].
///
/// # Errors
/// It cannot be read.
pub fn bytes(path: &Path) -> Result<Arc<[u8]>, InputError> {
    let mut bytes = Vec::new();
    if is_standard_input(path) {
        io::stdin().read_to_end(&mut bytes)?;
    } else {
        File::open(path)?.read_to_end(&mut bytes)?;
    }
    Ok(bytes.into())
}

/// An open job.
pub struct Input {
    reader: Box<dyn BufRead>,
    is_prepared: bool,
    description: Option<Description>,
    read: Rc<Cell<u64>>,
    size: u64,
}

impl Input {
    /// Opens a file, or standard input if the path is `-`, and decides from its first bytes what it is.
    ///
    /// # Errors
    /// It cannot be read, or is not a job. All checksums of binary G-code are compared.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        if is_standard_input(path) {
            return Self::new(Box::new(io::stdin()), None);
        }
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        // A pipe has no size.
        let size = metadata.is_file().then_some(metadata.len());
        Self::new(Box::new(file), size)
    }

    /// The same for bytes that have been read.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn of_bytes(bytes: Arc<[u8]>) -> Result<Self, InputError> {
        let size = bytes.len() as u64;
        Self::new(Box::new(Cursor::new(bytes)), Some(size))
    }

    fn new(file: Box<dyn Read>, size: Option<u64>) -> Result<Self, InputError> {
        let read = Rc::new(Cell::new(0));
        let mut reader: Box<dyn Read> = Box::new(Counting { inner: file, count: Rc::clone(&read) });
        let mut start = look(&mut reader)?;
        let is_gzip = start.starts_with(&[0x1f, 0x8b]);
        if is_gzip {
            let packed = BufReader::with_capacity(LOOK_BYTES, Cursor::new(start).chain(reader));
            reader = Box::new(MultiGzDecoder::new(packed));
            start = look(&mut reader)?;
        }
        if start.is_empty() {
            return Err(InputError::Empty);
        }
        let is_prepared = Header::is_gpre(&start);
        let is_binary = start.starts_with(&MAGIC);
        if !is_prepared && !is_binary {
            must_be_text(&start, if is_gzip { None } else { size })?;
        }
        if is_binary {
            let mut bytes = start;
            reader.read_to_end(&mut bytes)?;
            let description = Description::of(&bytes).map_err(InputError::Binary)?;
            let size = bytes.len() as u64;
            let text = binary::GcodeText::new(bytes, Rc::clone(&read));
            let reader = Box::new(BufReader::with_capacity(LOOK_BYTES, text));
            return Ok(Self { reader, is_prepared, description: Some(description), read, size });
        }
        let mut reader = BufReader::with_capacity(LOOK_BYTES, Cursor::new(start).chain(reader));
        if reader.fill_buf()?.starts_with(b"\xef\xbb\xbf") {
            // The byte order mark that some editors on Windows write.
            reader.consume(3);
        }
        Ok(Self { reader: Box::new(reader), is_prepared, description: None, read, size: size.unwrap_or(0) })
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

    /// The slicer's figures of its job: only in binary G-code.
    pub fn description(&self) -> Option<&Description> {
        self.description.as_ref()
    }

    /// A counter of the bytes read from the disk so far (compressed bytes, for gzip; of binary G-code its own bytes).
    pub fn counter(&self) -> Rc<Cell<u64>> {
        Rc::clone(&self.read)
    }

    /// Size of the file on the disk, bytes, as [`Self::counter`] counts; 0 for a pipe.
    pub fn size_bytes(&self) -> u64 {
        self.size
    }
}

/// The first bytes.
fn look(reader: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut start = vec![0; LOOK_BYTES];
    let mut length = 0;
    while length < AWAITED_BYTES && !start[..length].contains(&b'\n') {
        match reader.read(&mut start[length..]) {
            Ok(0) => break,
            Ok(read) => length += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    start.truncate(length);
    Ok(start)
}

/// Refuses a file that is not G-code.
fn must_be_text(start: &[u8], size: Option<u64>) -> Result<(), InputError> {
    if let Some(foreign) = Foreign::of(start, size) {
        return Err(InputError::Foreign(foreign));
    }
    // Bytes from 0x80 on may be UTF-8 in a comment; the line reader looks closer where it matters.
    let control = |byte: &u8| *byte < 0x20 && !b"\t\n\x0b\x0c\r\x1b".contains(byte);
    match start.iter().position(control) {
        Some(offset) => Err(InputError::NotText { offset, byte: start[offset] }),
        None => Ok(()),
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
