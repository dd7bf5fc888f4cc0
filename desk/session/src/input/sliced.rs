//! A sliced 3MF (`.gcode.3mf`), which Bambu Studio and OrcaSlicer export: a zip archive that holds
//! the G-code of its plates.
//!
//! The archive's directory and the G-code are read in portions, whatever their size.

use std::fmt;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use flate2::Crc;
use flate2::read::DeflateDecoder;
use rawzip::{CompressionMethod, RECOMMENDED_BUFFER_SIZE, ZipArchive, ZipArchiveEntryWayfinder};

use super::foreign::Foreign;

/// The most entries of an archive. Projects with hundreds of models have some thousands.
const MAX_ENTRIES: u64 = 100_000;

/// The most G-code of a plate, bytes.
const MAX_BYTES: u64 = (4 << 30) - 1;

/// More G-code than [`UNSUSPECTED_BYTES`] that is packed into a smaller share is no G-code: text as
/// slicers write it is packed into a third to a tenth, and equal layers into a hundredth.
const MAX_RATIO: u64 = 400;
const UNSUSPECTED_BYTES: u64 = 16 << 20;

/// The most plates that a message names one by one.
const NAMED_PLATES: usize = 10;

/// Reason for which no G-code comes from an archive.
#[derive(Debug)]
pub enum SlicedError {
    /// The archive cannot be read.
    Read(io::Error),
    /// The archive is damaged, and how.
    Damaged(String),
    /// The archive holds no G-code of a plate.
    NoPlate(Foreign),
    /// The archive holds several plates, by their numbers.
    SeveralPlates(Vec<u32>),
    /// The archive does not hold the plate that was asked for.
    OtherPlates {
        /// The plate asked for.
        plate: u32,
        /// The plates in the archive.
        plates: Vec<u32>,
    },
    /// The plate is encrypted.
    Encrypted(u32),
    /// The plate is packed in another way than Deflate.
    Method(u32),
    /// The plate is too large for a job.
    TooLarge {
        /// The plate.
        plate: u32,
        /// Size of the plate, bytes.
        bytes: u64,
    },
}

/// The numbers of plates, as messages list them.
struct Numbers<'a>(&'a [u32]);

impl fmt::Display for Numbers<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, plate) in self.0.iter().take(NAMED_PLATES).enumerate() {
            write!(out, "{}{plate}", if index > 0 { ", " } else { "" })?;
        }
        match self.0.last() {
            Some(last) if self.0.len() > NAMED_PLATES => write!(out, " ... {last}"),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for SlicedError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(error) => write!(out, "cannot be read: {error}"),
            Self::Damaged(how) => write!(out, "this is a damaged 3MF or zip archive ({how}): export or copy it again"),
            Self::NoPlate(foreign) => foreign.fmt(out),
            Self::SeveralPlates(plates) => {
                let (count, numbers) = (plates.len(), Numbers(plates));
                write!(out, "this is a sliced 3MF with {count} plates ({numbers}): choose one with --plate N")
            }
            Self::OtherPlates { plate, plates } => {
                write!(
                    out,
                    "this is a sliced 3MF without a plate {plate}, expected --plate with one of {}",
                    Numbers(plates)
                )
            }
            Self::Encrypted(plate) => {
                write!(out, "plate {plate} of this sliced 3MF is encrypted: export it without encryption")
            }
            Self::Method(plate) => write!(
                out,
                "plate {plate} of this sliced 3MF is not packed by Deflate, as slicers pack it: export it again, or unpack \
                 Metadata/plate_{plate}.gcode and give that"
            ),
            Self::TooLarge { plate, bytes } => write!(
                out,
                "plate {plate} of this sliced 3MF would be {:.1} GB of G-code, more than a job can be: is it damaged, or made to be?",
                *bytes as f64 / 1e9
            ),
        }
    }
}

impl From<io::Error> for SlicedError {
    fn from(error: io::Error) -> Self {
        Self::Read(error)
    }
}

impl From<rawzip::Error> for SlicedError {
    fn from(error: rawzip::Error) -> Self {
        match error.into_kind() {
            rawzip::ErrorKind::IO(error) if error.kind() != io::ErrorKind::UnexpectedEof => Self::Read(error),
            kind => Self::Damaged(rawzip::Error::from(kind).to_string()),
        }
    }
}

/// Entry of a plate's G-code in the archive's directory.
#[derive(Clone, Copy)]
struct Entry {
    plate: u32,
    wayfinder: ZipArchiveEntryWayfinder,
    is_encrypted: bool,
    /// True if it is packed; `None` for a method that this program does not know.
    is_packed: Option<bool>,
    checksum: u32,
}

/// The number of the plate whose G-code has this path in the archive.
fn plate_of(path: &[u8]) -> Option<u32> {
    let path = std::str::from_utf8(path).ok()?.to_ascii_lowercase().replace('\\', "/");
    let number = path.trim_start_matches('/').strip_prefix("metadata/plate_")?.strip_suffix(".gcode")?;
    number.bytes().all(|byte| byte.is_ascii_digit()).then(|| number.parse().ok()).flatten()
}

/// Returns true if an archive with this path in it is a 3MF.
fn is_of_project(path: &[u8]) -> bool {
    path.starts_with(b"3D/") || path == b"[Content_Types].xml"
}

/// A plate's G-code, whose checksum and length agree with the archive's directory.
pub struct PlateGcode {
    /// Reads it from its beginning.
    pub reader: Box<dyn Read>,
    /// Length of the G-code, bytes.
    pub bytes: u64,
}

/// Finds the G-code of a plate in an archive, or of its only plate, and reads it once to
/// compare its checksum.
///
/// # Errors
/// The archive cannot be read, is damaged, or does not hold the plate.
pub fn open(file: File, plate: Option<u32>) -> Result<PlateGcode, SlicedError> {
    let mut buffer = vec![0; RECOMMENDED_BUFFER_SIZE];
    let archive = ZipArchive::from_file(file, &mut buffer)?;
    let mut found: Vec<Entry> = Vec::new();
    let (mut count, mut is_project) = (0, false);
    let mut entries = archive.entries(&mut buffer);
    while let Some(entry) = entries.next_entry()? {
        count += 1;
        if count > MAX_ENTRIES {
            return Err(SlicedError::Damaged(format!("more than {MAX_ENTRIES} entries")));
        }
        let path = entry.file_path();
        is_project |= is_of_project(path.as_bytes());
        let Some(plate) = plate_of(path.as_bytes()) else { continue };
        let is_packed = match entry.compression_method() {
            CompressionMethod::STORE => Some(false),
            CompressionMethod::DEFLATE => Some(true),
            _ => None,
        };
        let (is_encrypted, checksum) = (entry.flags().is_encrypted(), entry.crc32());
        found.push(Entry { plate, wayfinder: entry.wayfinder(), is_encrypted, is_packed, checksum });
    }
    if count != archive.entries_hint() {
        return Err(SlicedError::Damaged(format!("{count} entries of {}", archive.entries_hint())));
    }
    let entry = chosen(found, plate, is_project)?;
    let plate = entry.plate;
    if entry.is_encrypted {
        return Err(SlicedError::Encrypted(plate));
    }
    let is_packed = entry.is_packed.ok_or(SlicedError::Method(plate))?;
    let bytes = entry.wayfinder.uncompressed_size_hint();
    let (from, to) = archive.get_entry(entry.wayfinder)?.compressed_data_range();
    let packed_bytes = to.saturating_sub(from);
    if bytes > MAX_BYTES || bytes > UNSUSPECTED_BYTES && bytes / packed_bytes.max(1) > MAX_RATIO {
        return Err(SlicedError::TooLarge { plate, bytes });
    }
    let file = archive.into_inner().into_inner();
    let reader = |mut file: File| -> io::Result<Box<dyn Read>> {
        file.seek(SeekFrom::Start(from))?;
        let packed = file.take(packed_bytes);
        let unpacked: Box<dyn Read> = if is_packed { Box::new(DeflateDecoder::new(packed)) } else { Box::new(packed) };
        Ok(Box::new(Checked { inner: unpacked, crc: Crc::new(), bytes, checksum: entry.checksum }))
    };
    // All of it before a line of it: a print must not stop in its middle.
    match io::copy(&mut reader(file.try_clone()?)?, &mut io::sink()) {
        Ok(_) => Ok(PlateGcode { reader: reader(file)?, bytes }),
        Err(error) => Err(SlicedError::Damaged(format!("plate {plate}: {error}"))),
    }
}

/// The entry of the plate that was asked for, or of the only one.
fn chosen(mut found: Vec<Entry>, plate: Option<u32>, is_project: bool) -> Result<Entry, SlicedError> {
    found.sort_by_key(|entry| entry.plate);
    let plates: Vec<u32> = found.iter().map(|entry| entry.plate).collect();
    if let Some([same, _]) = plates.array_windows().find(|[one, next]| one == next) {
        return Err(SlicedError::Damaged(format!("plate {same} is in it twice")));
    }
    match (plate, &found[..]) {
        (_, []) => Err(SlicedError::NoPlate(if is_project { Foreign::ThreeMf } else { Foreign::Zip })),
        (None, [only]) => Ok(*only),
        (None, _) => Err(SlicedError::SeveralPlates(plates)),
        (Some(plate), _) => {
            let entry = found.into_iter().find(|entry| entry.plate == plate);
            entry.ok_or(SlicedError::OtherPlates { plate, plates })
        }
    }
}

/// Reads on until the end, where length and checksum must be those of the archive's directory.
struct Checked {
    inner: Box<dyn Read>,
    crc: Crc,
    bytes: u64,
    checksum: u32,
}

impl Read for Checked {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.crc.update(buffer.get(..read).unwrap_or_default());
        // The length is counted modulo 2^32, and larger plates are refused.
        let length = u64::from(self.crc.amount());
        let is_at_end = read == 0 && !buffer.is_empty();
        let is_wrong = length > self.bytes || is_at_end && (length != self.bytes || self.crc.sum() != self.checksum);
        if is_wrong { Err(io::Error::new(io::ErrorKind::InvalidData, "wrong checksum or length")) } else { Ok(read) }
    }
}
