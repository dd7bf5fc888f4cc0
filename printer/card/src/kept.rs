//! The place of a print, kept on its card in case of a power cut: a file of two blocks that are
//! written in turn.
//!
//! A block counts only if its checksum is right, and the newer of two counts. A block spoilt by a
//! power cut therefore leaves the previous one in force. Neither the cluster table nor a folder is
//! written meanwhile. The place itself is bytes from the printer; this module adds the print's
//! file, by which it is recognised.

use embedded_sdmmc::RawFile;
use ferrostep_hal_shim::card::{Block, BlockDevice, BlockIdx, CardSlot};

use crate::failure::CardFailure;
use crate::listing::{SHORT_PATH_BYTES, ShortPath};
use crate::source::{CRC, open, read_block};
use crate::volume::{Manager, Mounted};

/// Name of the file, in the card's first folder. M20 does not list it.
pub const KEPT_NAME: &str = "FERROSTP.PLR";
/// Maximum number of bytes of a place.
pub const KEPT_BYTES: usize = 371;

/// The place of a print, as the printer writes it; empty without a place.
pub type Kept = heapless::Vec<u8, KEPT_BYTES>;

const MAGIC: [u8; 4] = *b"FSPL";
/// Version of the layout below; the place has its own version.
const VERSION: u8 = 1;
const FILE_BYTES: u32 = 2 * Block::LEN_U32;

// Layout of a block, little endian: magic, version, length of the path, length of the place,
// sequence number, length of the print's file, CRC of its first block, path, place, and at the end
// the CRC of all before.
const PATH_AT: usize = 20;
const PLACE_AT: usize = PATH_AT + SHORT_PATH_BYTES;
const CRC_AT: usize = Block::LEN - 4;
const _: () = assert!(PLACE_AT + KEPT_BYTES <= CRC_AT);

/// Places of the file's blocks on the card, and which of them is older.
#[derive(Clone, Copy, Debug)]
pub struct KeptFile {
    blocks: [BlockIdx; 2],
    /// Block that is written next.
    turn: bool,
    /// The number that it gets.
    sequence: u32,
}

impl KeptFile {
    /// The block to be written next, and its number.
    pub fn next(&self) -> (BlockIdx, u32) {
        let [first, second] = self.blocks;
        (if self.turn { second } else { first }, self.sequence)
    }

    /// Notes that the block has been written.
    pub fn has_written(&mut self) {
        self.turn = !self.turn;
        self.sequence = self.sequence.wrapping_add(1);
    }
}

/// A place that was read.
#[derive(Debug)]
pub struct Stored {
    /// Path of the print's file.
    pub path: ShortPath,
    /// Length, bytes.
    pub size: u32,
    /// CRC of its first block.
    pub first_crc: u32,
    /// The place.
    pub place: Kept,
}

/// A block that keeps a place; empty without a file.
pub fn compose(sequence: u32, file: Option<(&ShortPath, u32, u32)>, place: &[u8]) -> Block {
    let mut block = Block::new();
    let mut put = |at: usize, bytes: &[u8]| {
        block.contents.iter_mut().skip(at).zip(bytes).for_each(|(out, byte)| *out = *byte);
    };
    put(0, &MAGIC);
    put(4, &[VERSION]);
    put(8, &sequence.to_le_bytes());
    if let Some((path, size, first_crc)) = file {
        put(5, &[path.len() as u8]);
        put(6, &(place.len() as u16).to_le_bytes());
        put(12, &size.to_le_bytes());
        put(16, &first_crc.to_le_bytes());
        put(PATH_AT, path.as_bytes());
        put(PLACE_AT, place);
    }
    if let Some((body, end)) = block.contents.split_last_chunk_mut::<4>() {
        *end = CRC.checksum(body).to_le_bytes();
    }
    block
}

/// A block that keeps no place.
pub fn blank(sequence: u32) -> Block {
    compose(sequence, None, &[])
}

/// Number of a block, and its content; `None` if it is spoilt or of another version.
fn parse(bytes: &[u8; Block::LEN]) -> Option<(u32, Option<Stored>)> {
    let (body, crc) = bytes.split_last_chunk::<4>()?;
    let number = |at: usize| body.get(at..)?.first_chunk().map(|bytes| u32::from_le_bytes(*bytes));
    let [.., version, path_bytes, low, high] = *body.first_chunk::<8>()?;
    if !body.starts_with(&MAGIC) || version != VERSION || CRC.checksum(body) != u32::from_le_bytes(*crc) {
        return None;
    }
    let place_bytes = usize::from(u16::from_le_bytes([low, high]));
    let path = body.get(PATH_AT..PLACE_AT)?.get(..usize::from(path_bytes))?;
    let place = body.get(PLACE_AT..)?.get(..place_bytes)?;
    let stored = Stored {
        path: ShortPath::try_from(core::str::from_utf8(path).ok()?).ok()?,
        size: number(12)?,
        first_crc: number(16)?,
        place: Kept::from_slice(place).ok()?,
    };
    Some((number(8)?, Some(stored).filter(|stored| !stored.place.is_empty())))
}

/// Finds the file and reads its content.
///
/// # Errors
/// [`CardFailure::NotFound`] without one, [`CardFailure::OtherFile`] if another program has written
/// it; the card cannot be read.
pub fn locate<S: CardSlot>(manager: &Manager<S>, mounted: &Mounted) -> Result<(KeptFile, Option<Stored>), CardFailure> {
    let (file, size) = open(manager, mounted, KEPT_NAME)?;
    let mut kept = KeptFile { blocks: [BlockIdx(0); 2], turn: false, sequence: 0 };
    let (mut newest, mut failed) = (None, (size != FILE_BYTES).then_some(CardFailure::OtherFile));
    for (index, place) in kept.blocks.iter_mut().enumerate() {
        let mut block = Block::new();
        let read = read_at(manager, file, index as u32 * Block::LEN_U32, &mut block);
        *place = manager.device(|guard| guard.last_data());
        match read {
            Ok(()) => {}
            Err(CardFailure::OtherFile) => {
                failed = Some(CardFailure::OtherFile);
                break;
            }
            // The power cut may have made the block unreadable. It is written next.
            Err(failure) => {
                manager.device(|guard| guard.take_failed());
                failed = Some(failure);
                continue;
            }
        }
        if let Some((sequence, stored)) = parse(&block.contents)
            && newest.as_ref().is_none_or(|(other, _)| sequence > *other)
        {
            newest = Some((sequence, stored));
            (kept.turn, kept.sequence) = (index == 0, sequence.wrapping_add(1));
        }
    }
    let _ = manager.close_file(file);
    match (newest, failed) {
        (Some((_, stored)), failed) if failed != Some(CardFailure::OtherFile) => Ok((kept, stored)),
        (_, failed) => Err(failed.unwrap_or(CardFailure::OtherFile)),
    }
}

/// Reads a block of the file and checks that it is the one that the guard saw: it will be written
/// without the cluster table.
fn read_at<S: CardSlot>(manager: &Manager<S>, file: RawFile, at: u32, block: &mut Block) -> Result<(), CardFailure> {
    read_block(manager, file, at, &mut block.contents)?;
    manager.device(|guard| {
        let mut again = [Block::new()];
        guard.read(&mut again, guard.last_data())?;
        let [again] = &again;
        if again.contents == block.contents { Ok(()) } else { Err(CardFailure::OtherFile) }
    })
}
