//! The file being printed: read block by block, and recognised after its card was pulled out.

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use embedded_sdmmc::{Mode, RawFile};
use ferrostep_hal_shim::card::{Block, CardError, CardSlot};

use crate::failure::CardFailure;
use crate::guard::Purpose;
use crate::listing::ShortPath;
use crate::volume::{Manager, Mounted, close, find, open_folder, split_file};

/// CRC-32 as in gzip. A table would take 1 KB of flash, and save a tenth of a millisecond a block.
pub const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);
const BLOCK_BYTES: u32 = Block::LEN_U32;

/// Identifies a file after its card was pulled out: path, length, and its first and last
/// blocks that were read.
#[derive(Clone, Debug)]
pub struct Source {
    path: ShortPath,
    size: u32,
    /// Offset of the next block to read.
    offset: u32,
    first_crc: Option<u32>,
    /// The block before `offset`, and its CRC.
    last: Option<(u32, u32)>,
}

impl Source {
    /// Source at the beginning of a file.
    pub fn new(path: ShortPath, size: u32) -> Self {
        Self { path, size, offset: 0, first_crc: None, last: None }
    }

    /// The file's path, its length and the CRC of its first block, once that was read.
    pub fn known_identity(&self) -> Option<(&ShortPath, u32, u32)> {
        self.first_crc.map(|crc| (&self.path, self.size, crc))
    }

    /// Length of the file, and the CRC of its first block, which is read if it has not been yet:
    /// they identify the file after a reset.
    ///
    /// # Errors
    /// The card cannot be read.
    pub fn identity<S: CardSlot>(&mut self, manager: &Manager<S>, file: RawFile) -> Result<(u32, u32), CardFailure> {
        if let Some(crc) = self.first_crc {
            return Ok((self.size, crc));
        }
        let mut block = [0; Block::LEN];
        let length = read_block(manager, file, 0, &mut block)?;
        let crc = CRC.checksum(block.get(..length).unwrap_or_default());
        self.first_crc = Some(crc);
        Ok((self.size, crc))
    }

    /// Reads up to the end of the present block; returns the number of bytes, 0 at the
    /// end of the file.
    ///
    /// # Errors
    /// The card cannot be read; the place is unchanged.
    pub fn read<S: CardSlot>(
        &mut self,
        manager: &Manager<S>,
        file: RawFile,
        out: &mut [u8; Block::LEN],
    ) -> Result<usize, CardFailure> {
        let start = self.offset - self.offset % BLOCK_BYTES;
        let whole = read_block(manager, file, start, out)?;
        let crc = CRC.checksum(out.get(..whole).unwrap_or_default());
        if start == 0 {
            self.first_crc = Some(crc);
        }
        if whole > 0 {
            self.last = Some((start, crc));
        }
        // After M26, reading begins in the middle of a block.
        let skipped = (self.offset - start) as usize;
        out.copy_within(skipped.min(whole)..whole, 0);
        let length = whole.saturating_sub(skipped);
        self.offset = self.offset.saturating_add(length as u32);
        Ok(length)
    }

    /// Continues reading at this place.
    ///
    /// # Errors
    /// The place is beyond the end.
    pub fn seek(&mut self, offset: u32) -> Result<(), CardFailure> {
        if offset > self.size {
            return Err(CardFailure::NotFound);
        }
        self.offset = offset;
        Ok(())
    }

    /// Opens the file again, on what may be another card.
    ///
    /// # Errors
    /// The file is missing or differs, or the card cannot be read.
    pub fn reopen<S: CardSlot>(&self, manager: &Manager<S>, mounted: &Mounted) -> Result<RawFile, CardFailure> {
        let (file, size) = open(manager, mounted, &self.path)?;
        let checked = if size == self.size { self.check(manager, file) } else { Err(CardFailure::OtherFile) };
        if checked.is_err() {
            let _ = manager.close_file(file);
        }
        checked.map(|()| file)
    }

    fn check<S: CardSlot>(&self, manager: &Manager<S>, file: RawFile) -> Result<(), CardFailure> {
        let mut block = [0; Block::LEN];
        for (start, crc) in self.first_crc.map(|crc| (0, crc)).into_iter().chain(self.last) {
            let length = read_block(manager, file, start, &mut block)?;
            if CRC.checksum(block.get(..length).unwrap_or_default()) != crc {
                return Err(CardFailure::OtherFile);
            }
        }
        Ok(())
    }
}

/// Reads a file's block and returns its length.
///
/// # Errors
/// The card cannot be read, or the file is shorter.
pub fn read_block<S: CardSlot>(
    manager: &Manager<S>,
    file: RawFile,
    start: u32,
    out: &mut [u8; Block::LEN],
) -> Result<usize, CardFailure> {
    manager.device(|guard| guard.set_purpose(Purpose::Data));
    if start > manager.file_length(file)? {
        return Err(CardFailure::OtherFile);
    }
    manager.file_seek_from_start(file, start)?;
    Ok(manager.read(file, out)?)
}

/// Opens a file for reading; returns the file and its length.
///
/// # Errors
/// The file is missing, or longer than the card.
pub fn open<S: CardSlot>(manager: &Manager<S>, mounted: &Mounted, path: &str) -> Result<(RawFile, u32), CardFailure> {
    let (parent, name) = split_file(path);
    let folder = open_folder(manager, mounted, parent)?;
    let opened = find(manager, folder, name).and_then(|entry| {
        if entry.attributes.is_directory() {
            return Err(CardFailure::IsFolder);
        }
        if u64::from(entry.size) > mounted.layout.data_bytes() {
            return Err(CardFailure::Slot(CardError::Damaged));
        }
        Ok((manager.open_file_in_dir(folder, entry.name, Mode::ReadOnly)?, entry.size))
    });
    close(manager, folder);
    opened
}
