//! The job's file: G-code as text or binary, or in a sliced 3MF, or a prepared job, plain or gzip,
//! read in portions; or the same from standard input. The content decides the kind, not the name.

mod binary;
mod foreign;
mod place;
mod sliced;
mod sliced_for;

use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ferrostep_binary_gcode::{Error as BinaryError, MAGIC};
use ferrostep_gpre::Header;
use flate2::bufread::MultiGzDecoder;

use place::Counting;

pub use binary::{Description, SlicerFigures};
pub use ferrostep_host::printable::{is_standard_input, name_of_input as name};
pub use foreign::Foreign;
pub use place::Place;
pub use sliced::SlicedError;
pub use sliced_for::{Shown as ShownTravel, SlicedFor};

/// Bytes at the start of a file that are examined to tell text from binary data.
const LOOK_BYTES: usize = 64 * 1024;

/// Bytes at each end of a file in which slicers write their settings.
const SETTINGS_BYTES: u64 = 256 * 1024;

/// Bytes to wait for on a pipe that brings them piece by piece, or the end of a line: a person who
/// types G-code into a pipe gets an answer to each line.
const AWAITED_BYTES: usize = 512;

/// First bytes of a gzip file.
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// First bytes of a zip archive, and of an empty one.
const ZIP_MAGICS: [[u8; 4]; 2] = [*b"PK\x03\x04", *b"PK\x05\x06"];

/// The most bytes of an archive that comes through a pipe and is written to a file for a while: its
/// directory is at its end.
const MAX_PIPED_BYTES: u64 = 4 << 30;

/// The plate of a sliced 3MF that the command line names, 0 for none: it counts for each time that
/// a file is opened.
static PLATE: AtomicU32 = AtomicU32::new(0);

/// Reason for which a job could not be started from a file.
#[derive(Debug)]
pub enum InputError {
    /// The file cannot be opened or read.
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
    /// A zip archive without the G-code that is looked for.
    Sliced(SlicedError),
    /// A plate was asked for of a file that has no plates.
    NoPlates,
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
            Self::Sliced(error) => error.fmt(out),
            Self::NoPlates => {
                write!(out, "--plate is for a sliced 3MF (.gcode.3mf), which this file is not: leave it out")
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

/// Chooses the plate of the sliced 3MFs that this process opens from now on; none: their only one.
pub fn choose_plate(plate: Option<u32>) {
    PLATE.store(plate.unwrap_or(0), Ordering::Relaxed);
}

/// All bytes of a file, or of standard input if the path is `-`, as they are: for
/// [`Input::of_bytes`].
///
/// # Errors
/// The file cannot be read.
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
    place: Rc<Place>,
}

impl Input {
    /// Opens a file, or standard input if the path is `-`, and decides from its first
    /// bytes what it is.
    ///
    /// # Errors
    /// The file cannot be read, or is not a job. All checksums of binary G-code are compared.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        if is_standard_input(path) {
            return Self::new(Box::new(io::stdin()), None);
        }
        let mut file = File::open(path)?;
        let metadata = file.metadata()?;
        // A pipe has no size.
        let size = metadata.is_file().then_some(metadata.len());
        if size.is_some() && is_zip(&mut file)? {
            return Self::of_plate(file);
        }
        if size.is_some() && begins_with(&mut file, &[MAGIC])? {
            if PLATE.load(Ordering::Relaxed) > 0 {
                return Err(InputError::NoPlates);
            }
            return Self::of_binary(file, metadata.len(), Rc::default());
        }
        let unpacked_size = if size.is_some() { gzip_size(&mut file)? } else { 0 };
        let input = Self::new(Box::new(file), size)?;
        input.place.unpacked_size.set(unpacked_size);
        Ok(input)
    }

    /// The same for bytes that have been read.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn of_bytes(bytes: Arc<[u8]>) -> Result<Self, InputError> {
        let size = bytes.len() as u64;
        Self::new(Box::new(Cursor::new(bytes)), Some(size))
    }

    /// The G-code of a plate in a zip archive.
    fn of_plate(file: File) -> Result<Self, InputError> {
        let plate = Some(PLATE.load(Ordering::Relaxed)).filter(|plate| *plate > 0);
        let plate = sliced::open(file, plate).map_err(InputError::Sliced)?;
        Self::of_contents(plate.reader, Some(plate.bytes), true)
    }

    /// Binary G-code, which is read more than once.
    fn of_binary(mut file: impl Read + Seek + 'static, size: u64, place: Rc<Place>) -> Result<Self, InputError> {
        let description = Description::of(&mut file)?;
        place.size.set(size);
        let text = binary::GcodeText::new(file, Rc::clone(&place));
        let text = Counting { inner: text, place: Rc::clone(&place), count: |place| &place.unpacked };
        let reader = Box::new(BufReader::with_capacity(LOOK_BYTES, text));
        Ok(Self { reader, is_prepared: false, description: Some(description), place })
    }

    fn new(file: Box<dyn Read>, size: Option<u64>) -> Result<Self, InputError> {
        Self::of_contents(file, size, false)
    }

    fn of_contents(file: Box<dyn Read>, size: Option<u64>, is_plate: bool) -> Result<Self, InputError> {
        let place = Rc::new(Place::default());
        place.size.set(size.unwrap_or(0));
        let counting = |inner: Box<dyn Read>, count| -> Box<dyn Read> {
            Box::new(Counting { inner, place: Rc::clone(&place), count })
        };
        let mut file = file;
        let mut start = look(&mut file)?;
        let is_gzip = start.starts_with(&GZIP_MAGIC);
        let file = Cursor::new(start).chain(file);
        let mut reader: Box<dyn Read> = if is_gzip {
            // Bytes consumed by the decoder count, not those that a buffer has read for it.
            let inner = BufReader::with_capacity(LOOK_BYTES, file);
            Box::new(MultiGzDecoder::new(Counting { inner, place: Rc::clone(&place), count: |place| &place.fetched }))
        } else {
            counting(Box::new(file), |place| &place.fetched)
        };
        start = look(&mut reader)?;
        if start.is_empty() {
            return Err(InputError::Empty);
        }
        if ZIP_MAGICS.iter().any(|magic| start.starts_with(magic)) && !is_plate {
            // Its directory is at its end, where a pipe cannot go.
            let mut file = tempfile::tempfile()?;
            let copied = io::copy(&mut Cursor::new(start).chain(reader).take(MAX_PIPED_BYTES), &mut file)?;
            if copied == MAX_PIPED_BYTES {
                return Err(InputError::Sliced(SlicedError::Damaged("more than 4 GiB".to_owned())));
            }
            file.rewind()?;
            return Self::of_plate(file);
        }
        if PLATE.load(Ordering::Relaxed) > 0 && !is_plate {
            return Err(InputError::NoPlates);
        }
        if start.starts_with(&MAGIC) {
            let mut bytes = start;
            reader.read_to_end(&mut bytes)?;
            let size = bytes.len() as u64;
            return Self::of_binary(Cursor::new(bytes), size, place);
        }
        let is_prepared = Header::is_gpre(&start);
        if !is_prepared {
            must_be_text(&start, if is_gzip { None } else { size })?;
        }
        let unpacked = counting(Box::new(Cursor::new(start).chain(reader)), |place| &place.unpacked);
        let mut reader = BufReader::with_capacity(LOOK_BYTES, unpacked);
        if reader.fill_buf()?.starts_with(b"\xef\xbb\xbf") {
            // The byte order mark that some editors on Windows write.
            reader.consume(3);
            place.take(3);
        }
        Ok(Self { reader: Box::new(reader), is_prepared, description: None, place })
    }

    /// Puts bytes back in front of those that remain, for the next reader.
    pub fn put_back(&mut self, bytes: Vec<u8>) {
        self.place.put_back(bytes.len());
        let rest = std::mem::replace(&mut self.reader, Box::new(io::empty()));
        self.reader = Box::new(Cursor::new(bytes).chain(rest));
    }

    /// Returns true if it is a prepared job (GPRE), not G-code.
    pub fn is_prepared(&self) -> bool {
        self.is_prepared
    }

    /// The slicer's figures of its job: only in binary G-code.
    pub fn description(&self) -> Option<&Description> {
        self.description.as_ref()
    }

    /// The printer that it was sliced for, as the slicer describes it; of a pipe, whose end comes
    /// too late, nothing.
    ///
    /// # Errors
    /// The file at `path`, which this is, cannot be read once more.
    pub fn sliced_for(&self, path: &Path) -> io::Result<SlicedFor> {
        if let Some(description) = &self.description {
            return Ok(description.sliced_for.clone());
        }
        let mut said = SlicedFor::default();
        if self.is_prepared || is_standard_input(path) || !path.metadata()?.is_file() {
            return Ok(said);
        }
        let [start, end] = ends(path)?;
        said.read(&start);
        said.read(&end);
        Ok(said)
    }

    /// Returns the progress of reading it.
    pub fn place(&self) -> Rc<Place> {
        Rc::clone(&self.place)
    }

    /// Size of the file on the disk, bytes; 0 for a pipe.
    pub fn size_bytes(&self) -> u64 {
        self.place.size.get()
    }
}

/// The packing around a job's text, gzip or a zip archive; `None` for a file that is the job
/// itself.
///
/// # Errors
/// The file cannot be read.
pub fn packing(path: &Path) -> io::Result<Option<&'static str>> {
    let mut file = File::open(path)?;
    if is_zip(&mut file)? {
        return Ok(Some("a zip archive"));
    }
    let mut magic = [0; 2];
    let is_gzip = file.read_exact(&mut magic).is_ok() && magic == GZIP_MAGIC;
    Ok(is_gzip.then_some("packed with gzip"))
}

/// The first and the last [`SETTINGS_BYTES`] of a job's text, in which slicers
/// write their settings.
fn ends(path: &Path) -> io::Result<[Vec<u8>; 2]> {
    let (mut start, mut end) = (Vec::new(), Vec::new());
    if packing(path)?.is_some() {
        // An end that is packed can only be reached through all that is before it.
        let Ok(mut text) = Input::open(path) else { return Ok([start, end]) };
        (&mut text).take(SETTINGS_BYTES).read_to_end(&mut start)?;
        while (&mut text).take(SETTINGS_BYTES).read_to_end(&mut end)? > 0 {
            let surplus = end.len().saturating_sub(SETTINGS_BYTES as usize);
            end.drain(..surplus);
        }
    } else {
        let mut file = File::open(path)?;
        (&mut file).take(SETTINGS_BYTES).read_to_end(&mut start)?;
        let size = file.seek(SeekFrom::End(0))?;
        file.seek(SeekFrom::Start(size.saturating_sub(SETTINGS_BYTES).max(start.len() as u64)))?;
        file.take(SETTINGS_BYTES).read_to_end(&mut end)?;
    }
    Ok([start, end])
}

/// Returns true if a file is a zip archive. Rewinds the file.
fn is_zip(file: &mut File) -> io::Result<bool> {
    begins_with(file, &ZIP_MAGICS)
}

/// Returns true if a file begins with one of these. Rewinds the file.
fn begins_with(file: &mut File, magics: &[[u8; 4]]) -> io::Result<bool> {
    let mut magic = [0; 4];
    let begins = file.read_exact(&mut magic).is_ok() && magics.contains(&magic);
    file.rewind()?;
    Ok(begins)
}

/// The size in a gzip file's last four bytes; 0 for another file. Rewinds the file.
fn gzip_size(file: &mut File) -> io::Result<u64> {
    let mut magic = [0; 2];
    let mut last = [0; 4];
    // A file that is too short for both is not gzip.
    let is_gzip = file.read_exact(&mut magic).is_ok() && magic == GZIP_MAGIC;
    let is_read = is_gzip && file.seek(SeekFrom::End(-4)).is_ok() && file.read_exact(&mut last).is_ok();
    file.rewind()?;
    Ok(if is_read { u32::from_le_bytes(last).into() } else { 0 })
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
        let read = self.reader.read(buffer)?;
        self.place.take(read);
        Ok(read)
    }
}

impl BufRead for Input {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.reader.fill_buf()
    }

    fn consume(&mut self, bytes: usize) {
        self.reader.consume(bytes);
        self.place.take(bytes);
    }
}
