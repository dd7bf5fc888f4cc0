//! The sectors of a flash in which records are kept.
//!
//! A sector is divided into slots, each for one record with a number and a checksum. The newest
//! record is the one with the largest number among those with a valid checksum, whatever the other
//! bytes are. A new record goes into the next empty slot of the newest one's sector; if that sector
//! is full, the next one, which never holds the newest record, is erased for it. So a power cut at
//! any word, or during an erasure, loses nothing, whatever it leaves; and all sectors wear alike.
//!
//! | bytes | content of a slot |
//! |---|---|
//! | 4 | number, from 1 on |
//! | 2, 2 | length of the record, and its complement |
//! | 4 | CRC-32 (ISO-HDLC) of the bytes before and of the record |
//! | ... | the record, then 0xff |

use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use embedded_storage::nor_flash::NorFlash;

use crate::record::MAX_BYTES;

/// Length of a slot, bytes.
pub const SLOT_BYTES: usize = 1024;

const HEAD_BYTES: usize = 12;
const LARGEST_WORD_BYTES: usize = 16;
const _: () = assert!(HEAD_BYTES + MAX_BYTES + LARGEST_WORD_BYTES <= SLOT_BYTES);

/// Bytes that are read at once to see whether they are erased.
const CHUNK_BYTES: usize = 64;

const CHECKSUM: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Message for a memory that gives no cause.
pub const NOT_WORKING: &str = "the memory for settings does not work";

/// Reason why settings are not stored, or not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError {
    /// The memory has refused to read, write or erase, or does not contain what was written; the
    /// text names the failure.
    Memory(&'static str),
    /// The record does not fit.
    TooLong,
    /// The length is not a multiple of the sector size, or is below two sectors.
    Sectors,
}

impl fmt::Display for StoreError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Memory(fault) => fault,
            Self::TooLong => "there are more settings than the memory holds",
            Self::Sectors => "the memory for settings has too few sectors",
        })
    }
}

impl core::error::Error for StoreError {}

/// A slot that was read.
pub type Slot = [u8; SLOT_BYTES];

/// Place of the newest record.
#[derive(Clone, Copy)]
struct Newest {
    address: u32,
    number: u32,
}

/// Records in a flash of two sectors or more. Errors of the flash are texts for a person.
#[derive(Debug)]
pub struct Store<F> {
    flash: F,
}

impl<F: NorFlash<Error: Into<&'static str>>> Store<F> {
    /// Store that uses a whole flash; nothing is read or written yet.
    ///
    /// # Errors
    /// [`StoreError::Sectors`]: the sectors do not hold whole slots, or are fewer than two.
    pub fn new(flash: F) -> Result<Self, StoreError> {
        let bytes = flash.capacity();
        let has_sectors = bytes.is_multiple_of(F::ERASE_SIZE) && bytes >= F::ERASE_SIZE.saturating_mul(2);
        let fits = F::ERASE_SIZE.is_multiple_of(SLOT_BYTES)
            && SLOT_BYTES.is_multiple_of(F::READ_SIZE)
            && F::WRITE_SIZE <= LARGEST_WORD_BYTES
            && LARGEST_WORD_BYTES.is_multiple_of(F::WRITE_SIZE);
        if has_sectors && fits { Ok(Self { flash }) } else { Err(StoreError::Sectors) }
    }

    /// The newest record; `None` if the memory is empty. Writes nothing.
    ///
    /// # Errors
    /// The flash does not work.
    pub fn load<'s>(&mut self, slot: &'s mut Slot) -> Result<Option<&'s [u8]>, StoreError> {
        let Some(newest) = self.newest(slot)? else { return Ok(None) };
        self.read_record(newest.address, slot)?;
        Ok(record_in(slot).map(|(_, record)| record))
    }

    /// Stores a record in place of the previous one.
    ///
    /// # Errors
    /// The flash does not work, or the record is too long.
    pub fn save(&mut self, record: &[u8]) -> Result<(), StoreError> {
        let mut slot = [0xff; SLOT_BYTES];
        let newest = self.newest(&mut slot)?;
        let length = fill(&mut slot, newest.map_or(0, |newest| newest.number).wrapping_add(1), record)?;
        let address = match newest {
            Some(newest) => match self.empty_slot_after(newest.address)? {
                Some(address) => address,
                None => self.erase_sector_after(newest.address)?,
            },
            None => self.erase(0)?,
        };
        let words = slot.get(..length.next_multiple_of(F::WRITE_SIZE)).ok_or(StoreError::TooLong)?;
        self.flash.write(address, words).map_err(fault)?;
        // Exactly the written bytes must be read back.
        if self.contains(address, words)? { Ok(()) } else { Err(StoreError::Memory(NOT_WORKING)) }
    }

    /// The flash.
    pub fn flash(&self) -> &F {
        &self.flash
    }

    /// Ends the store and returns its flash.
    pub fn into_flash(self) -> F {
        self.flash
    }

    /// Place of the newest record; `slot` is a buffer for reading.
    fn newest(&mut self, slot: &mut Slot) -> Result<Option<Newest>, StoreError> {
        let mut newest: Option<Newest> = None;
        for address in (0..self.flash.capacity() as u32).step_by(SLOT_BYTES) {
            // Most slots are empty or have another number: their heads show it.
            let mut head = [0; HEAD_BYTES];
            self.read(address, &mut head)?;
            let number = number_of(&head);
            if number == 0 || number == u32::MAX || newest.is_some_and(|newest| newest.number >= number) {
                continue;
            }
            self.read_record(address, slot)?;
            if record_in(slot).is_some() {
                newest = Some(Newest { address, number });
            }
        }
        Ok(newest)
    }

    /// The start of the sector in which an address lies.
    fn sector(address: u32) -> u32 {
        address.saturating_sub(address % F::ERASE_SIZE as u32)
    }

    fn empty_slot_after(&mut self, address: u32) -> Result<Option<u32>, StoreError> {
        // A memory of small sectors needs none of this.
        if F::ERASE_SIZE == SLOT_BYTES {
            return Ok(None);
        }
        let end = Self::sector(address).saturating_add(F::ERASE_SIZE as u32);
        for slot in (address..end).step_by(SLOT_BYTES).skip(1) {
            if self.contains(slot, &[0xff; SLOT_BYTES])? {
                return Ok(Some(slot));
            }
        }
        Ok(None)
    }

    /// Erases the sector after that of an address, which holds nothing to keep; returns its start.
    fn erase_sector_after(&mut self, address: u32) -> Result<u32, StoreError> {
        let next = Self::sector(address).saturating_add(F::ERASE_SIZE as u32);
        self.erase(if (next as usize) < self.flash.capacity() { next } else { 0 })
    }

    /// Erases a sector, although it may look empty: after an erasure that was cut short its
    /// cells may forget.
    fn erase(&mut self, sector: u32) -> Result<u32, StoreError> {
        let end = sector.saturating_add(F::ERASE_SIZE as u32);
        self.flash.erase(sector, end).map_err(fault)?;
        Ok(sector)
    }

    /// Reads a slot as far as its head announces a record: a memory on a slow bus would take long
    /// for all of it.
    fn read_record(&mut self, address: u32, slot: &mut Slot) -> Result<(), StoreError> {
        let (head, _) = slot.split_at_mut(HEAD_BYTES);
        self.read(address, head)?;
        let length = head.get(4..).and_then(<[u8]>::first_chunk).map_or(0, |bytes| u16::from_le_bytes(*bytes));
        let end = (HEAD_BYTES + usize::from(length)).next_multiple_of(F::READ_SIZE).min(SLOT_BYTES);
        self.read(address, slot.get_mut(..end).unwrap_or_default())
    }

    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), StoreError> {
        self.flash.read(address, bytes).map_err(fault)
    }

    /// True if the flash contains these bytes.
    fn contains(&mut self, address: u32, bytes: &[u8]) -> Result<bool, StoreError> {
        let mut read = [0; CHUNK_BYTES];
        for (at, expected) in (address..).step_by(CHUNK_BYTES).zip(bytes.chunks(CHUNK_BYTES)) {
            let read = read.get_mut(..expected.len()).unwrap_or_default();
            self.read(at, read)?;
            if read != expected {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

fn fault(error: impl Into<&'static str>) -> StoreError {
    StoreError::Memory(error.into())
}

fn number_of(head: &[u8]) -> u32 {
    head.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

/// The checksum of a slot's number, length and record.
fn checksum(start: &[u8], record: &[u8]) -> [u8; 4] {
    let mut digest = CHECKSUM.digest();
    digest.update(start);
    digest.update(record);
    digest.finalize().to_le_bytes()
}

/// Writes a record and its head into an otherwise erased slot; returns their length, bytes.
fn fill(slot: &mut Slot, number: u32, record: &[u8]) -> Result<usize, StoreError> {
    slot.fill(0xff);
    let too_long = |_| StoreError::TooLong;
    let length = u16::try_from(record.len()).map_err(too_long)?;
    let (head, rest) = slot.split_first_chunk_mut::<HEAD_BYTES>().ok_or(StoreError::TooLong)?;
    rest.get_mut(..record.len().min(MAX_BYTES))
        .filter(|_| record.len() <= MAX_BYTES)
        .ok_or(StoreError::TooLong)?
        .copy_from_slice(record);
    let (start, sum) = head.split_first_chunk_mut::<{ HEAD_BYTES - 4 }>().ok_or(StoreError::TooLong)?;
    let [n0, n1, n2, n3] = number.to_le_bytes();
    let [[l0, l1], [c0, c1]] = [length, !length].map(u16::to_le_bytes);
    start.copy_from_slice(&[n0, n1, n2, n3, l0, l1, c0, c1]);
    sum.copy_from_slice(&checksum(start, record));
    Ok(HEAD_BYTES + record.len())
}

/// The number and the record of a slot; `None` if it does not contain a whole one.
fn record_in(slot: &Slot) -> Option<(u32, &[u8])> {
    let (head, rest) = slot.split_first_chunk::<HEAD_BYTES>()?;
    let (start, sum) = head.split_last_chunk::<4>()?;
    let (_, lengths) = start.split_first_chunk::<4>()?;
    let [length, complement] =
        [lengths.get(..2)?, lengths.get(2..)?].map(|bytes| bytes.first_chunk().map(|bytes| u16::from_le_bytes(*bytes)));
    let length = length.filter(|length| complement == Some(!length))?;
    let record = rest.get(..usize::from(length))?;
    (*sum == checksum(start, record)).then(|| (number_of(head), record))
}
