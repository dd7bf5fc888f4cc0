//! An EEPROM 24C32 as a flash of four sectors, so that the records of settings lie in it as in a
//! chip's own flash.
//!
//! 4 KiB in pages of 32 bytes; after a page the EEPROM writes for up to 10 ms (AT24C32 of 2.7 V; 5
//! ms: AT24C32E, 24LC32A, M24C32) and does not acknowledge its address meanwhile: it is asked
//! again until it does. An erasure writes 0xff, 32 pages. Nothing depends on the time that a write
//! takes, so that any task may interrupt this one. Each page lasts 1,000,000 writes (the same data
//! sheets, endurance).
//!
//! A cut of the power within a page leaves anything in its 32 bytes, and nothing elsewhere.
#![cfg_attr(not(test), no_std)]

use embedded_hal::i2c::{Error, ErrorKind, I2c, NoAcknowledgeSource, Operation};
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

/// Length of the memory, bytes.
pub const BYTES: usize = 4096;

/// Bytes that are written together, and that a write does not go beyond.
pub const PAGE_BYTES: usize = 32;

/// Bytes that are erased together: room for a record.
pub const SECTOR_BYTES: usize = 1024;

/// The slowest bus on which `MAX_ASKED` is meant, and the fastest that every 24C32
/// knows at 3.3 V, Hz.
pub const BUS_HZ: u32 = 100_000;

/// Maximum number of requests to an EEPROM that does not acknowledge its address: each takes at
/// least 10 clocks, so that together they take twice the longest time of a write.
const MAX_ASKED: u32 = 200;

/// A fault of the EEPROM or of its bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EepromFault {
    /// No acknowledge of its address for longer than a write takes.
    Silent,
    /// The EEPROM does not acknowledge data.
    Protected,
    /// The bus: one of its lines stays low.
    Bus,
    /// No such bytes.
    Place,
}

impl NorFlashError for EepromFault {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl From<NorFlashErrorKind> for EepromFault {
    fn from(_: NorFlashErrorKind) -> Self {
        Self::Place
    }
}

impl From<EepromFault> for &'static str {
    fn from(fault: EepromFault) -> Self {
        match fault {
            EepromFault::Silent => "the EEPROM does not answer",
            EepromFault::Protected => "the EEPROM refuses to be written (write-protected?)",
            EepromFault::Bus => "a line of the EEPROM (SCL or SDA) stays low",
            EepromFault::Place => "the EEPROM is too small",
        }
    }
}

/// The EEPROM.
#[derive(Debug)]
pub struct Eeprom<B> {
    bus: B,
    address: u8,
}

impl<B: I2c> Eeprom<B> {
    /// The EEPROM at an address from 0x50 to 0x57, on a bus of [`BUS_HZ`] at most.
    /// Nothing is asked yet.
    pub const fn new(bus: B, address: u8) -> Self {
        Self { bus, address }
    }

    /// Names a place and runs an operation there: repeats the request until the chip has
    /// written its last bytes.
    #[inline(never)]
    fn at(&mut self, place: u32, operation: Operation<'_>) -> Result<(), EepromFault> {
        let [.., high, low] = place.to_be_bytes();
        let place = [high, low];
        let mut operations = [Operation::Write(&place), operation];
        for _ in 0..MAX_ASKED {
            match self.bus.transaction(self.address, &mut operations).map_err(|error| error.kind()) {
                Ok(()) => return Ok(()),
                Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data)) => return Err(EepromFault::Protected),
                Err(ErrorKind::NoAcknowledge(_)) => {}
                Err(_) => return Err(EepromFault::Bus),
            }
        }
        Err(EepromFault::Silent)
    }
}

impl<B> ErrorType for Eeprom<B> {
    type Error = EepromFault;
}

impl<B: I2c> ReadNorFlash for Eeprom<B> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), EepromFault> {
        check_read(self, offset, bytes.len())?;
        if bytes.is_empty() { Ok(()) } else { self.at(offset, Operation::Read(bytes)) }
    }

    fn capacity(&self) -> usize {
        BYTES
    }
}

impl<B: I2c> NorFlash for Eeprom<B> {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), EepromFault> {
        check_erase(self, from, to)?;
        let mut page = from;
        while page < to {
            self.at(page, Operation::Write(&[0xff; PAGE_BYTES]))?;
            page = page.saturating_add(PAGE_BYTES as u32);
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), EepromFault> {
        check_write(self, offset, bytes.len())?;
        let (mut place, mut rest) = (offset, bytes);
        // Page by page; the first part may begin inside a page.
        while !rest.is_empty() {
            let room = PAGE_BYTES - place as usize % PAGE_BYTES;
            let (page, others) = rest.split_at(room.min(rest.len()));
            self.at(place, Operation::Write(page))?;
            place = place.saturating_add(room as u32);
            rest = others;
        }
        Ok(())
    }
}
